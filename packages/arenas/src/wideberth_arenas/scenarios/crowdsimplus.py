"""CrowdSimPlus by its own rules: three people in a hallway who see the robot, walls that stop."""

from dataclasses import dataclass
from typing import ClassVar, final

import numpy as np

from wideberth.framework.values.arrays import checked_choice
from wideberth.framework.values.path import Path
from wideberth.framework.values.polygon import Polygon
from wideberth.simulation.crowds.base import CrowdWorld
from wideberth.simulation.crowds.hall import Layout
from wideberth.simulation.engine.settings import Settings
from wideberth.simulation.engine.world import Rules
from wideberth.simulation.scenarios.base import Cast, Placement, Scenario

from ..crowds.crowdsimplus import (
    ROBOT_RADIUS,
    CrowdSimPlusCrowd,
    Kind,
    hall_of,
)


@final
@dataclass(frozen=True)
class CrowdSimPlusRules(Rules):
    """The crowd and the verdict of one case; see `CrowdSimPlusCrowd`."""

    case: int
    layout: Layout
    people: Kind
    attributes: bool

    def world(self, settings: Settings) -> CrowdWorld:
        """Return a world with the case at time 0."""
        crowd = CrowdSimPlusCrowd(self.case, self.layout, self.people, attributes=self.attributes)
        return CrowdWorld(crowd, settings)


@final
@dataclass(frozen=True)
class CrowdSimPlus(Scenario):
    """The hallways of CrowdSimPlus, case for case, by its own rules.

    The robot goes up a hallway from (0, -1.5) to (0, 1.5) in 15 s; three people, who see it,
    walk up and down, through a door where there is one. They begin 2.5 s before time 0. A wall
    shortens whatever step would come nearer to it than the body's radius, people's and the
    robot's: no one slides along it. Contacts are counted and end nothing.

    The row of a case, in columns ``judged_...``, is described at
    `wideberth_arenas.crowds.crowdsimplus.CrowdSimPlusVerdict.row`. A success may have
    collisions: look at ``judged_success``, ``judged_clean`` and ``judged_coll_freq`` together.

    Seed k is the test case k, drawn from ``default_rng(1000 + k)``. The settings of an episode
    that make it the original's: ``plant_step: 0.25``, ``history: 0``, ``channel: {noise: 0}``,
    ``time_limit`` above 15.25. Its own planners turn by at most 60 degrees a step, drive at most
    0.95 m/s and accelerate by at most 0.5 m/s^2; the environment has no limits.

    Where `Hallway` has fields, this one has the numbers of the original's experiment.

    Parameters
    ----------
    layout : "open", "static", "static_with_back", "bottleneck" or "squeeze".
    people_kind : "orca_plus", who walk by ORCA and know the walls, or "sfm", by social forces.
    attributes : draw the preferred speed of each in [0.5, 1.5] m/s, as its experiment does; all
        have 1.5 m/s if not. The draws that follow are others, too.

    Raises
    ------
    WideberthError : an unknown layout or kind of people.
    """

    reference: ClassVar[str] = "samavi2024sicnav"
    robot_radius = ROBOT_RADIUS

    layout: Layout = "bottleneck"
    people_kind: Kind = "orca_plus"
    attributes: bool = True

    def __post_init__(self) -> None:
        checked_choice("crowdsimplus.layout", self.layout, Layout)
        checked_choice("crowdsimplus.people_kind", self.people_kind, Kind)

    def cast(self, seed: int) -> Cast:
        """Place the robot; the rules have the rest."""
        rng = np.random.default_rng(seed)
        return Cast(self.build(rng), polygons=self.polygons(rng), rules=self._rules(seed))

    def build(self, rng: np.random.Generator) -> tuple[Placement, ...]:
        """Place the robot, standing; the same for every seed."""
        reach = hall_of(self.layout).circle_radius
        way = Path(np.array([[0.0, -reach], [0.0, reach]]))
        return (Placement("robot", way, 0.0, reference_speed=1.0),)

    def polygons(self, rng: np.random.Generator) -> tuple[Polygon, ...]:
        """Walls and door, as bodies for planners; the same for every seed."""
        return hall_of(self.layout).polygons()

    def _rules(self, seed: int) -> CrowdSimPlusRules:
        return CrowdSimPlusRules(seed, self.layout, self.people_kind, self.attributes)
