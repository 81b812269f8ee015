"""CrowdNav++: twenty people who change their goals and are replaced; a robot that sees 5 m far."""

from dataclasses import dataclass
from typing import ClassVar, Literal, final

import numpy as np

from wideberth.framework.values.arrays import checked_choice, whole
from wideberth.framework.values.errors import WideberthError
from wideberth.framework.values.path import Path
from wideberth.simulation.crowds.base import CrowdWorld
from wideberth.simulation.engine.settings import Settings
from wideberth.simulation.engine.world import Rules
from wideberth.simulation.scenarios.base import Cast, Placement, Scenario

from ..crowds.crowdnav_plus import RADIUS, CrowdNavPlusCrowd, Phase, Variant
from ..crowds.gensafenav import Shift

CASES = 500
"""Test cases of the original."""
MOST = 2**31 - 1
"""Largest S: with a case of that size the generator still takes it."""


@final
@dataclass(frozen=True)
class CrowdNavPlusRules(Rules):
    """The crowd and the verdict of one case; see `CrowdNavPlusCrowd`."""

    case: int
    variant: Variant
    seed: int
    phase: Phase
    shift: Shift

    def world(self, settings: Settings) -> CrowdWorld:
        """Return the case at time 0."""
        return CrowdWorld(self.crowd(), settings)

    def crowd(self) -> CrowdNavPlusCrowd:
        """Return the people of the case at time 0."""
        return CrowdNavPlusCrowd(self.case, self.variant, self.seed, self.phase, self.shift)


@final
@dataclass(frozen=True)
class CrowdNavPlus(Scenario):
    """The cases of CrowdNav++, seed for seed, by its own rules.

    The robot crosses a square of 12 m x 12 m, at least 8 m far, in 49 s. Twenty people, who do not
    see it, cross a circle of 8.49 m by ORCA; a person who arrives is replaced by another at a
    drawn place on the circle. In the variant "random" the radius (0.3 to 0.5 m), preferred speed
    (0.5 to 1.5 m/s) and neighbour distance of each are drawn, and every 5 s each changes the goal
    with a chance of 1/2. The variant "gensafenav" is the one in which GenSafeNav tests: "random",
    but with other draws, since its conformal inference takes some from the same generator. The
    robot sees people up to 5 m away (between surfaces).

    The rules judge the state every 0.25 s before anybody moves: timeout (49 s), collision (an
    overlap at that instant), success (the robot's centre within 0.3 m of the goal). The row of a
    case, in columns ``judged_...``, is described at `CrowdNavPlusVerdict.row`.

    An evaluation k of the original is test case 2k modulo 500, since two resets follow each other
    there: every even case is run twice, no odd one ever. So 250 seeds are the whole benchmark;
    more repeat them.

    The settings of an episode that make it the original's: ``plant_step: 0.25``, ``history: 0``,
    ``channel: {noise: 0}``, ``time_limit`` above 49, ``goal_tolerance: 0.3``. Robots with limited
    accelerations are no part of the original.

    Parameters
    ----------
    variant : "plain" or "random".
    seed : S of the original; 425 in the rows that could be verified. Case c draws from
        ``RandomState(1000 + c + S)``, in "validation" from ``RandomState(c + S)``.
    cases : "evaluated" for those that the original's logs have: seed k is the evaluation k;
        "all" for seed k as the case k.
    phase : "test", or "validation" to choose settings on, with any number of cases.
    shift : how people differ from those, as in GenSafeNav's tests out of distribution.
        "social_force": all walk by the social force of its code, which is exact. "rushing": each
        prefers 2 m/s, with a chance of 1/5. "groups": they walk in groups of 2 to 4 that have one
        goal and one speed, change it and are replaced together; the row has ``group_percent``.
        Its code has neither of these two, so that their numbers are ours.

    Raises
    ------
    WideberthError : a field out of range.

    References
    ----------
    S. Liu et al., Intention aware robot crowd navigation with attention-based interaction graph
    (2023), and its code. J. Yao et al., Towards generalizable safety in crowd navigation via
    conformal uncertainty handling (2025), and its code.
    """

    reference: ClassVar[str] = "liu2023intention"

    variant: Variant = "plain"
    seed: int = 425
    cases: Literal["evaluated", "all"] = "evaluated"
    phase: Phase = "test"
    shift: Shift = "none"
    robot_radius = RADIUS

    def __post_init__(self) -> None:
        checked_choice("crowdnav_plus.variant", self.variant, Variant)
        checked_choice("crowdnav_plus.cases", self.cases, Literal["evaluated", "all"])
        checked_choice("crowdnav_plus.phase", self.phase, Phase)
        checked_choice("crowdnav_plus.shift", self.shift, Shift)
        whole("crowdnav_plus.seed", self.seed, least=0)
        if self.seed > MOST:
            raise WideberthError(
                f"crowdnav_plus.seed is {self.seed}; wanted a whole number of at most {MOST}"
            )

    def case(self, seed: int) -> int:
        """Return the number of the case of a seed; the test cases begin again after 500."""
        if self.phase == "validation":
            return seed
        return (2 * seed if self.cases == "evaluated" else seed) % CASES

    def cast(self, seed: int) -> Cast:
        """Draw the case of a seed, all from one generator as in the original."""
        rules = self._rules(self.case(seed))
        return Cast(_placed(rules), rules=rules)

    def build(self, rng: np.random.Generator) -> tuple[Placement, ...]:
        """Draw a case, and place its robot."""
        return _placed(self._rules(int(rng.integers(CASES))))

    def _rules(self, case: int) -> CrowdNavPlusRules:
        return CrowdNavPlusRules(case, self.variant, self.seed, self.phase, self.shift)


def _placed(rules: CrowdNavPlusRules) -> tuple[Placement, ...]:
    crowd = rules.crowd()
    way = Path(np.stack([crowd.robot, crowd.robot_goal]))
    return (Placement("robot", way, 0.0, reference_speed=1.0),)
