"""Two flying robots cross in a volume through which others pass."""

from dataclasses import dataclass
from typing import final

import numpy as np

from ...framework.values.arrays import Array, whole
from ...framework.values.errors import WideberthError
from ...framework.values.path import Path
from ...metrics.episode import approach
from ..engine.agents import ScriptedAgent
from .base import PHASE, Placement, Scenario, draw_value

ROOM = 0.5
"""m between surfaces that a passer-by leaves to the other passers-by, and to the robots at first
(all taken for as large as it is)."""
CALM = 3.0
"""s after time 0 during which it leaves that much to the robots."""
DRAWS = 1000
"""Tries to place a passer-by before all of them are drawn anew."""
ATTEMPTS = 10
"""Times that all are drawn before the ranges are said to leave no room."""
REACH = (7.0, 9.0)
"""m, range of e."""
LAG = (-1.0, 1.0)
"""s, range of l; negative where the second one is ahead."""
AZIMUTH = (0.8, 2.4)
"""rad, range of psi_2."""
CLIMB = (-0.35, 0.35)
"""rad, range of both climb angles; negative downwards."""
PASSER_SPEED = (0.5, 1.0)
"""m/s, range of the passers-by."""
PASSER_RADIUS = 0.35
"""m, of a passer-by."""
SHARE = (0.3, 0.75)
"""Range of the share of the path at which a passer-by is met."""
SWAY = 0.2
"""m, amplitude b of a passer-by."""
WAVELENGTH = 8.0
"""m, L of a passer-by."""
SPEED = 1.0
"""m/s, reference speed of the robots and speed at time 0."""


@final
@dataclass(frozen=True)
class Crossing3D(Scenario):
    """Two straight paths in space that cross in the origin, and passers-by on wavy ways.

    With reach e, lag l, speed v, azimuths psi_1 = 0 and psi_2 and climb angles gamma_k::

        d_k = (cos gamma_k cos psi_k, cos gamma_k sin psi_k, sin gamma_k)
        path k from -(e +- l v / 2) d_k to e d_k

    so that undisturbed the first robot is in the origin l seconds before the second.

    A passer-by is aimed at one robot, at a share of its path, and at a random direction
    n. Undisturbed the robot would be at that place p at the time t, and so is the
    passer-by, but for a sway of amplitude b and wavelength L about its straight way::

        q(a) = p + a n + b (sin(2 pi a / L + phi_1) e_1 + sin(2 pi a / L + phi_2) e_2)

    n, e_1, e_2 orthonormal. It keeps its speed and makes way for no one; its accelerations,
    about b (2 pi v / L)^2, are what no predictor with straight forecasts can know. One that
    would come too near a start, or too near another passer-by, is drawn again.

    Parameters
    ----------
    passers : number of passers-by; they are aimed at the two robots in turn.

    Raises
    ------
    WideberthError : a range that is not ordered or out of bounds; when drawing, no room.
    """

    passers: int = 4

    def __post_init__(self) -> None:
        whole("crossing_3d.passers", self.passers, least=0)

    def build(self, rng: np.random.Generator) -> tuple[Placement, ...]:
        """Draw reach, lag, azimuth, the two climb angles and the two phases."""
        reach = draw_value(rng, REACH)
        half = 0.5 * SPEED * draw_value(rng, LAG)
        azimuths = (0.0, draw_value(rng, AZIMUTH))
        placements = []
        for name, azimuth, before in zip(
            ("first", "second"), azimuths, (-half, half), strict=True
        ):
            climb = draw_value(rng, CLIMB)
            flat = np.cos(climb) * np.array([np.cos(azimuth), np.sin(azimuth)])
            along = np.array([*flat, np.sin(climb)])
            path = Path(np.array([-(reach + before) * along, reach * along]))
            placements.append(Placement(name, path, SPEED, draw_value(rng, PHASE)))
        return tuple(placements)

    def bystanders(
        self, rng: np.random.Generator, placements: tuple[Placement, ...]
    ) -> tuple[ScriptedAgent, ...]:
        """Draw the passers-by one after the other; all anew where the last ones find no room.

        Raises
        ------
        WideberthError : no room in `ATTEMPTS` attempts of 1000 draws a passer-by.
        """
        fullest = 0
        for _ in range(ATTEMPTS):
            found = self._passers(rng, placements)
            if len(found) == self.passers:
                return tuple(found)
            fullest = max(fullest, len(found))
        raise WideberthError(
            f"passer {fullest + 1} of {self.passers} found no room between the others in "
            f"{ATTEMPTS} attempts of {DRAWS} draws; state fewer passers"
        )

    def _passers(
        self, rng: np.random.Generator, placements: tuple[Placement, ...]
    ) -> list[ScriptedAgent]:
        """Draw passers-by until all are there, or the next one finds no room."""
        found: list[ScriptedAgent] = []
        for number in range(self.passers):
            target = placements[number % len(placements)]
            tries = (self._passer(rng, target, f"passer {number + 1}") for _ in range(DRAWS))
            fitting = (one for one in tries if self._has_room(one, placements, found))
            passer = next(fitting, None)
            if passer is None:
                break
            found.append(passer)
        return found

    def _passer(self, rng: np.random.Generator, target: Placement, name: str) -> ScriptedAgent:
        """Draw a way through the place where the robot would be at some time."""
        arc = draw_value(rng, SHARE) * target.path.length
        speed = draw_value(rng, PASSER_SPEED)
        frame, triangle = np.linalg.qr(rng.standard_normal((3, 3)))
        along, *aside = (frame * np.sign(np.diag(triangle))).T  # uniform among all frames
        turns = rng.uniform(0.0, 2.0 * np.pi, 2)
        span = 2.0 * target.path.length  # to where it disturbs no one when it stops there
        arcs = np.arange(-span, span, 0.05 * WAVELENGTH)
        waves = np.sin(2.0 * np.pi * arcs[:, None] / WAVELENGTH + turns)
        points = target.path.at(np.array(arc)) + np.outer(arcs, along) + SWAY * (waves @ aside)
        way = Path(points)
        met = way.arc[int(np.argmin(np.abs(arcs)))]
        start = arc / target.speed - met / speed
        return ScriptedAgent(name, way, speed, PASSER_RADIUS, start)

    def _has_room(
        self, passer: ScriptedAgent, placements: tuple[Placement, ...], others: list[ScriptedAgent]
    ) -> bool:
        """Whether it keeps clear of the robots at first, and of the other passers-by."""
        last = max(one.path.length / one.speed for one in placements)
        early, late = np.linspace(0.0, CALM, 31), np.linspace(0.0, 1.5 * last, 301)
        wanted = ROOM + 2.0 * PASSER_RADIUS
        gaps: list[Array] = [
            approach(passer.at(early), one.path.at(one.speed * early)) for one in placements
        ]
        gaps += [approach(passer.at(late), one.at(late)) for one in others]
        return all(float(gap.min()) >= wanted for gap in gaps)
