"""Calibration of skid-steered bodies in the physics: how they follow their wheels."""

from collections.abc import Iterator, Mapping
from dataclasses import dataclass, field, replace
from typing import Any, ClassVar, Self, final

import numpy as np

from wideberth.experiments import GridStudy, Result, Row, Task, TaskOutcome, subplots
from wideberth.experiments.drawing.plotting import PAGE, legend_below, style
from wideberth.experiments.engine.closed_loop import column
from wideberth.experiments.studies.grid import labelled
from wideberth.framework import WideberthError
from wideberth.framework.values.arrays import Array, positive

from ..physics.body import LARGE, SkidSteerBody
from ..physics.calibration import (
    RATES,
    SPEEDS,
    Driven,
    fitted,
    measured,
    suggested_yaw_gain,
)
from ..physics.mujoco_module import mujoco

CONES = ("pyramidal", "elliptic")
MARKERS = "osD^vP"
STRAIGHT = 1e-3
"""rad/s, within which a robot drives straight."""
DRIVEN = {
    "forward": "forward_m_s",
    "lateral": "lateral_m_s",
    "yaw_rate": "yaw_rate_rad_s",
    "least": "least_rad_s",
    "largest": "largest_rad_s",
    "jitter": "jitter_rad_s",
    "droop": "droop_m_s",
}
"""What is measured of a motion -> its column."""
WANTED = 0.3
"""rad/s, yaw rate that the suggested yaw gain is for: the most of the paper's robots."""


@final
@dataclass(frozen=True)
class WheelCalibration(GridStudy):
    """Rims at constant speed, and the motion of the body that follows.

    A robot that did not slip would turn at ``rate_rad_s``; the yaw gain is what it really turns
    at, over that. Every motion is begun at four headings: friction as a pyramid, MuJoCo's own,
    holds wheels better along the axes of the world than between them; as an ellipse it is the
    same in all directions.

    Attributes
    ----------
    bodies : by name.
    speeds : m/s; 0 is a spin on the spot. The largest is driven straight too.
    rates : rad/s, growing.
    seconds : s, over which a motion is averaged, after 0.5 s.
    """

    bodies: dict[str, SkidSteerBody] = field(
        default_factory=lambda: {"small": SkidSteerBody(), "large": LARGE}
    )
    speeds: tuple[float, ...] = SPEEDS
    rates: tuple[float, ...] = RATES
    seconds: float = 1.0

    claim: ClassVar[str] = (
        "A skid-steered robot turns at about B^2 / (B^2 + L^2) of the yaw rate of its wheels, "
        "if its servos are stiff and its wheels not too light."
    )

    def __post_init__(self) -> None:
        if not self.bodies:
            raise WideberthError("bodies is empty; wanted one at least, by name")
        for speed in self.speeds:
            positive("speeds", speed, zero=True)
        for rate in self.rates:
            positive("rates", rate)
        if not max(self.speeds, default=0.0) or not self.rates:
            raise WideberthError(
                f"speeds are {self.speeds} and rates {self.rates}; wanted a speed above 0 and a "
                "rate at least"
            )
        if any(after <= before for before, after in zip(self.rates, self.rates[1:], strict=False)):
            raise WideberthError(f"rates are {self.rates}; wanted each larger than that before")
        positive("seconds", self.seconds)

    def axes(self) -> Mapping[Any, Any]:
        """Each body with each shape of the friction."""
        return {"body": self.bodies, "cone": CONES}

    def check(self) -> None:
        """Import MuJoCo."""
        mujoco()

    def measure(self, task: Task) -> TaskOutcome:
        """Drive one body straight, on the spot and on arcs."""
        name, cone = str(task.settings["body"]), task.settings["cone"]
        found = measured(
            self.bodies[name], speeds=self.speeds, rates=self.rates, cone=cone,
            seconds=self.seconds,
        )  # fmt: skip
        return TaskOutcome([
            {
                "body": name, "cone": cone, "speed_m_s": speed, "rate_rad_s": rate,
                **{column: round(getattr(one, own), 6) for own, column in DRIVEN.items()},
            }
            for (speed, rate), one in found.items()
        ])  # fmt: skip

    def summary(self, rows: list[Row]) -> list[Row]:
        """Gains of each body against the theory, and how it drives straight."""
        lines: list[Row] = []
        for labels, some in labelled(rows, "body", "cone"):
            body = self.bodies[labels["body"]]
            turned = [row for row in some if row["rate_rad_s"]]
            model, rates = fitted(body, _measured(some)), column(turned, "rate_rad_s")
            lines.append({
                **labels,
                "straight": round(model.forward, 4),
                "yaw_gain": round(float(np.mean(model.gains)), 3),
                "least": round(float((column(turned, "least_rad_s") / rates).min()), 3),
                "largest": round(float((column(turned, "largest_rad_s") / rates).max()), 3),
                "theory": round(body.theoretical_yaw_gain, 3),
                "suggested": round(suggested_yaw_gain(model, WANTED), 3),
                "droop_m_s": round(float(column(turned, "droop_m_s").max()), 4),
            })  # fmt: skip
        return lines

    def pictures(self, result: Result) -> Iterator[tuple[str, Any]]:
        """Draw the yaw gains with either friction, and the point about which a robot turns."""
        figure, panels = subplots(1, 3, figsize=(PAGE, 2.7), width_ratios=(1.2, 1.2, 1.0))
        for place, cone in enumerate(CONES):
            self._draw_gains(panels[place], result.rows, cone)
        self._draw_aside(panels[2], result.rows)
        panels[0].set_ylabel("yaw gain")
        panels[1].sharey(panels[0])
        theories = [body.theoretical_yaw_gain for body in self.bodies.values()]
        panels[0].set_ylim(0.0, 1.35 * max(theories))
        for panel in panels:
            panel.set(xscale="log", xlabel="yaw rate without slip (rad/s)")
        legend_below(figure, panels[:1], ncols=len(self.bodies))
        yield "wheel_calibration", figure

    def quick(self) -> Self:
        """Three rates at two speeds."""
        few = tuple(sorted({self.rates[0], self.rates[len(self.rates) // 2], self.rates[-1]}))
        return replace(
            self, speeds=tuple(sorted({min(self.speeds), max(self.speeds)})), rates=few,
            seconds=min(self.seconds, 0.4),
        )  # fmt: skip

    def _draw_gains(self, panel: Any, rows: list[Row], cone: str) -> None:
        for index, name in enumerate(self.bodies):
            rates, gains, least, largest = _gains(rows, name, cone)
            look = _style(index)
            if _holds(_of(rows, name, cone)):
                band = {"color": look["color"], "alpha": 0.15, "linewidth": 0}
                panel.fill_between(rates, least, largest, **band)
            panel.plot(rates, gains, label=name, **look)
        for theory in sorted({round(one.theoretical_yaw_gain, 3) for one in self.bodies.values()}):
            panel.axhline(theory, color="0.4", linestyle=":", linewidth=0.9)
            panel.annotate(
                f"{theory:.3f}", (1.0, theory), xycoords=("axes fraction", "data"),
                xytext=(-1, 1), textcoords="offset points", ha="right", fontsize=6, color="0.3",
            )  # fmt: skip
        panel.set_title(f"friction: {'a pyramid' if cone == CONES[0] else 'an ellipse'}")

    def _draw_aside(self, panel: Any, rows: list[Row]) -> None:
        for index, (name, body) in enumerate(self.bodies.items()):
            some = _of(rows, name, CONES[0])
            if _holds(some):
                model = fitted(body, _measured(some))
                panel.plot(model.rates, model.aside, **_style(index))
        panel.set_ylabel("centre of the turn ahead\nof the middle, over speed (s)")
        panel.set_title("friction: a pyramid")


def _style(index: int) -> dict[str, Any]:
    return {**style(index, MARKERS), "markersize": 3}


def _holds(rows: list[Row]) -> bool:
    """Return whether a body never turns the wrong way; bands of one that does fill the panel."""
    return bool(column(rows, "least_rad_s").min() > -STRAIGHT)


def _of(rows: list[Row], body: str, cone: str) -> list[Row]:
    return [row for row in rows if row["body"] == body and row["cone"] == cone]


def _measured(rows: list[Row]) -> dict[tuple[float, float], Driven]:
    """Return what was measured, of the rows of one body."""
    return {
        (float(row["speed_m_s"]), float(row["rate_rad_s"])): Driven(
            **{own: float(row[column]) for own, column in DRIVEN.items()}
        )
        for row in rows
    }


def _gains(rows: list[Row], body: str, cone: str) -> tuple[Array, Array, Array, Array]:
    """Return rates, and mean, least and largest gain at each."""
    found = []
    for head, some in labelled(_of(rows, body, cone), "rate_rad_s"):
        rate = head["rate_rad_s"]
        if rate:
            ends = column(some, "least_rad_s").min(), column(some, "largest_rad_s").max()
            mean = column(some, "yaw_rate_rad_s").mean()
            found.append((rate, *(np.array([mean, *ends]) / rate)))
    rates, gains, least, largest = np.array(found, dtype=np.float64).T
    return rates, gains, least, largest
