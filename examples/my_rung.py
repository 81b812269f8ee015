"""A rung of one's own in the fallback ladder; ``my_rung.png`` shows the plan it gives.

Where the solver fails and no last plan is left, the planner brakes. `SlowDown` offers something
gentler before that: straight on at half the speed, as long as that keeps every constraint.
"""

from dataclasses import dataclass
from typing import ClassVar, final

import matplotlib.pyplot as plt
import numpy as np
from matplotlib.patches import Circle

from wideberth import Detection, Observation, Path, Twist, build
from wideberth.framework import FallbackRung, NotHeld, Solver, steer

START = (0.0, 0.0, 0.0, 0.6, 0.0)  # x, y in m, heading in rad, speed in m/s, yaw rate in rad/s
PERSON = (6.5, 0.3)  # m
RADIUS = 0.4  # m, of robot and person


@final
@dataclass(frozen=True)
class SlowDown(FallbackRung):
    """Drive straight on at a share of the present speed.

    Parameters
    ----------
    share : of the present speed.
    """

    name: ClassVar[str] = "slow down"
    share: float = 0.5

    def attempt(self, trial):
        """Steer towards the lower speed, and check that against every constraint."""
        instance = trial.instance
        robot, start = instance.robot, instance.parameters.initial
        speed = robot.twist(tuple(start), (0.0,) * len(robot.inputs)).linear
        slower = Twist(tuple(self.share * part for part in speed), 0.0)
        states, inputs = steer(robot, start, slower, instance.problem.horizon, instance.problem.dt)
        plan = trial.at_lowest_level(states, inputs)
        if plan.feasible:
            return plan
        return NotHeld((f"{self.name}: {plan.found.where(instance.names)}",))


@final
@dataclass(frozen=True)
class Unavailable(Solver):
    """A solver that always fails, so that the ladder is needed."""

    def solve(self, problem, parameters, guesses, deadline=None):
        """Fail."""
        raise RuntimeError("no licence")


def plan_with(rungs):
    """Plan once with these rungs."""
    planner = build(
        "controllers",
        {
            "type": "mpc",
            "robot": {"type": "unicycle", "radius": RADIUS},
            "region": "mahalanobis_ellipse",
            "predictor": "static",
            "level": "fixed",
            "solver": "my_rung:Unavailable",
            "fallback": {"rungs": rungs},
        },
    )
    planner.set_path(Path([(0, 0), (20, 0)]))
    person = Detection("person", PERSON, 1e-4 * np.eye(2), RADIUS)
    planner.command(Observation(0.0, START, (person,)))
    return planner.plan


def draw(plans, file):
    """Draw the positions of some plans."""
    figure, axes = plt.subplots(figsize=(7, 2.5))
    axes.add_patch(Circle(PERSON, RADIUS, color="0.7"))
    for plan, marker in zip(plans, "os", strict=True):
        axes.plot(*plan.positions.T, marker=marker, fillstyle="none", label=str(plan.rung))
    axes.set(xlabel="x / m", ylabel="y / m", aspect="equal")
    axes.legend()
    figure.savefig(file, dpi=150, bbox_inches="tight")


if __name__ == "__main__":
    built_in = ["optimal", "feasible iterate", "shifted last plan", "least violation", "brake"]
    own = [*built_in[:3], "my_rung:SlowDown", *built_in[3:]]
    plans = [plan_with(rungs) for rungs in (built_in, own)]
    for plan in plans:
        print(f"The plan is on the rung {plan.rung!s}: {plan.reason}")
    draw(plans, "my_rung.png")
