"""Calibrations: one file per method, each says how large regions have to be.

The table below is all that is needed to list them; nothing is imported until one is used.
"""

from ...framework.plugins.lazy import lazy

BUILT_IN: dict[str, str] = {
    "boole": "wideberth.predictors.calibrations.boole:Boole",
    "joint_person": "wideberth.predictors.calibrations.joint_person:JointPerson",
    "joint_plan": "wideberth.predictors.calibrations.joint_plan:JointPlan",
    "per_step": "wideberth.predictors.calibrations.per_step:PerStep",
    "sample_and_discard": "wideberth.predictors.calibrations.sample_and_discard:SampleAndDiscard",
    "task": "wideberth.predictors.calibrations.task:WholeTask",
}

__getattr__, __dir__, __all__ = lazy(__name__, BUILT_IN.values())
