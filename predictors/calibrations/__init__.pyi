# Written by `make types` from the table in __init__.py: change that, not this.
# ruff: noqa
# fmt: off

from .boole import Boole as Boole
from .joint_person import JointPerson as JointPerson
from .joint_plan import JointPlan as JointPlan
from .per_step import PerStep as PerStep
from .sample_and_discard import SampleAndDiscard as SampleAndDiscard
from .task import WholeTask as WholeTask
__all__ = ['Boole', 'JointPerson', 'JointPlan', 'PerStep', 'SampleAndDiscard', 'WholeTask']
BUILT_IN: dict[str, str]
