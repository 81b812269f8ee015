"""Measure in the physics how a body follows its wheels: straight, on the spot, on arcs."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from typing import final

import numpy as np

from wideberth.framework.values.arrays import Array
from wideberth.framework.values.motion import Twist

from .body import SkidSteerBody
from .scene import Cone, PhysicalRobot, PhysicalScene
from .slip import SlipModel
from .world import PhysicsWorld

HEADINGS: Array = np.linspace(0.0, 0.5 * np.pi, 4, endpoint=False)
"""rad, in the world, at which a motion is begun: friction repeats itself after a quarter turn."""
SPEEDS = (0.0, 0.25, 0.5, 1.0)
"""m/s."""
RATES = (0.02, 0.05, 0.1, 0.2, 0.3, 0.6, 1.0, 2.0)
"""rad/s, of a robot that did not slip."""
_APART = 50.0
"""m between robots."""
_SETTLED = 0.5
"""s, after which the motion is measured."""


@final
@dataclass(frozen=True)
class Driven:
    """How a body really moves with rims at constant speed; the mean over time and headings.

    Attributes
    ----------
    forward, lateral : m/s.
    yaw_rate, least, largest : rad/s; of all headings, and of those with the least and the
        largest.
    jitter : rad/s, standard deviation of the yaw rate from its mean.
    droop : m/s, by which the rims fall short of their speeds in the mean.
    """

    forward: float
    lateral: float
    yaw_rate: float
    least: float
    largest: float
    jitter: float
    droop: float


def driven(
    body: SkidSteerBody,
    forward: float,
    yaw_rate: float,
    *,
    cone: Cone = "pyramidal",
    seconds: float = 1.0,
) -> Driven:
    """Drive a body with the rims of a robot that does not slip, and measure.

    Parameters
    ----------
    body : its ``yaw_gain`` is taken as 1.
    forward : m/s.
    yaw_rate : rad/s, omega_d.
    cone : of the friction, see `PhysicalScene`.
    seconds : s, over which is averaged, after 0.5 s.
    """
    body = replace(body, yaw_gain=1.0)
    robots = tuple(
        PhysicalRobot(f"{index}", body, np.array([0.0, _APART * index, heading]))
        for index, heading in enumerate(HEADINGS.tolist())
    )
    world = PhysicsWorld(PhysicalScene(robots, cone=cone), np.random.default_rng(0))
    for robot in robots:
        world.command(robot.name, Twist((forward, 0.0), yaw_rate))
    world.advance(_SETTLED)
    begin = np.array([world.truth(robot.name).pose[2] for robot in robots])
    steps = max(round(seconds / world.scene.time_step), 1)
    twists, rims = np.empty((steps, len(robots), 3)), np.empty((steps, len(robots), 4))
    for step in range(steps):
        world.advance(world.scene.time_step)
        for index, robot in enumerate(robots):
            truth = world.truth(robot.name)
            twists[step, index], rims[step, index] = truth.twist, truth.wheel_speeds
    turned = np.array([world.truth(robot.name).pose[2] for robot in robots]) - begin
    duration = steps * world.scene.time_step
    # The heading counts, the mean of the rate only says how many whole turns it has made.
    turns = np.round((twists[..., 2].mean(axis=0) * duration - turned) / (2.0 * np.pi))
    rates = (turned + 2.0 * np.pi * turns) / duration
    wanted = np.repeat(body.rim_speeds(forward, yaw_rate), 2)
    return Driven(
        float(twists[..., 0].mean()), float(twists[..., 1].mean()), float(rates.mean()),
        float(rates.min()), float(rates.max()), float((twists[..., 2] - rates).std()),
        float(np.abs(rims.mean(axis=(0, 1)) - wanted).mean()),
    )  # fmt: skip


def measured(
    body: SkidSteerBody,
    *,
    speeds: Sequence[float] = SPEEDS,
    rates: Sequence[float] = RATES,
    cone: Cone = "pyramidal",
    seconds: float = 1.0,
) -> dict[tuple[float, float], Driven]:
    """Drive a body straight at the largest speed, and at each speed with each yaw rate.

    Parameters
    ----------
    body : to be measured.
    speeds : m/s, not negative, one of them above 0; 0 is a spin on the spot.
    rates : rad/s, growing, above 0, of a robot that does not slip.
    cone, seconds : see `driven`.

    Returns
    -------
    What was measured, by speed and rate.
    """
    motions = [(max(speeds), 0.0), *((speed, rate) for rate in rates for speed in speeds)]
    return {motion: driven(body, *motion, cone=cone, seconds=seconds) for motion in motions}


def fitted(body: SkidSteerBody, found: Mapping[tuple[float, float], Driven]) -> SlipModel:
    """Return the model of a body's slip by what was `measured` of it.

    f is that of the straight drive. At each rate g is the mean over the speeds, and a the slope
    of the lateral speed over -vx omega by least squares.
    """
    ((top, straight),) = ((speed, one) for (speed, rate), one in found.items() if not rate)
    gains, aside = [], []
    rates = sorted({rate for _, rate in found if rate})
    for wanted in rates:
        some = [one for (_, rate), one in found.items() if rate == wanted]
        turned = np.array([one.yaw_rate for one in some])
        pull = turned * np.array([one.forward for one in some])
        lateral = np.array([one.lateral for one in some])
        gains.append(float(turned.mean()) / wanted)
        aside.append(max(float(-lateral @ pull / (pull @ pull)), 0.0))
    return SlipModel(
        body.track, np.array(rates), np.array(gains), np.array(aside),
        forward=straight.forward / top,
    )  # fmt: skip


def suggested_yaw_gain(model: SlipModel, rate: float = 0.3) -> float:
    """Return the yaw gain that suits a body for a yaw rate, rad/s, that it shall really reach."""
    return rate / float(np.interp(rate, model.gains * model.rates, model.rates))
