"""The world of robots with wheels and sensors."""

from collections.abc import Sequence
from dataclasses import replace
from math import atan2
from typing import final

import numpy as np

from wideberth.framework.control.velocity_smoother import VelocitySmoother
from wideberth.framework.plugins.registry import unknown
from wideberth.framework.robot import Robot
from wideberth.framework.values.arrays import Array
from wideberth.framework.values.errors import WideberthError
from wideberth.framework.values.motion import Command, Observation, Pose, Twist
from wideberth.framework.values.plan import Plan
from wideberth.framework.values.polygon import Polygon
from wideberth.simulation.engine.agents import Bystander, RobotAgent
from wideberth.simulation.engine.driver import Driver
from wideberth.simulation.engine.exchanged_positions import ExchangedPositions
from wideberth.simulation.engine.plant import KinematicPlant, Plant
from wideberth.simulation.engine.settings import Settings
from wideberth.simulation.engine.world import Around, World
from wideberth.simulation.log.frames import RigidMotion
from wideberth.simulation.log.perception_log import (
    PerceptionLog,
    PipelineStop,
    TrueBody,
    TrueStage,
)

from ..physics.scene import PhysicalPerson, PhysicalRobot, PhysicalScene
from ..physics.sensors import Sensor
from ..physics.world import KinematicWorld, SlippingWorld, TrueMotion
from ..physics.world import PhysicsWorld as PhysicalWorld
from .cascade import SensingPipeline
from .senses import Senses

_HALT = Command((0.0, 0.0), ramp=0.5)
"""With 0.5 m/s that brakes at 1 m/s^2."""
_ELSEWHERE = 1e4
"""m, where those are who are absent: no sensor sees so far."""
WORLDS: dict[str, type[PhysicalWorld]] = {
    "physics": PhysicalWorld,
    "slip": SlippingWorld,
    "kinematic": KinematicWorld,
}
"""World of each of the cascade's mechanics."""
_LITTLE = 1e-3
"""s, over which the velocity of those who decide nothing is measured."""


@final
class WheeledPlant(Plant):
    """A robot's body in the physical world, and the smoother before its wheels.

    Parameters
    ----------
    robot : the model that describes its state.
    truth : how it stands at the start.
    """

    def __init__(self, robot: Robot, truth: TrueMotion) -> None:
        self.robot: Robot = robot
        self._smoother = VelocitySmoother.at_rest(Twist((0.0, 0.0)))
        self.control: tuple[float, ...] = (0.0,) * len(robot.inputs)
        self._reason = ""
        self._stops: list[PipelineStop] = []
        self.follow(truth)
        self.believe(truth.pose[:2])

    def command(self, command: Command, time: float) -> None:
        """Take a command that arrives at ``time``, s; one that is stopped takes none."""
        if not self._reason:
            self._smoother = self._smoother.aim(command, time)

    def guard(self, reason: str, time: float) -> None:
        """Stop for a reason; with "" the next command counts again.

        What stands behind a colon in a reason may change while it lasts.
        """
        if reason.partition(":")[0] == self._reason.partition(":")[0]:
            return
        if self._reason:
            self._stops[-1] = self._stops[-1]._replace(end=time)
        if reason:
            self._smoother = self._smoother.aim(_HALT, time)
            self._stops.append(PipelineStop(time, np.inf, reason))
        self._reason = reason

    def stops(self, now: float) -> tuple[PipelineStop, ...]:
        """Return when and why it was stopped up to now, s."""
        return tuple(one._replace(end=min(one.end, now)) for one in self._stops)

    def wanted(self, time: float) -> Twist:
        """Return what the wheels shall do at a time, s."""
        return self._smoother.at(time)

    def advance(self, time: float, duration: float) -> None:
        """Move with the world, see `follow`."""

    def follow(self, truth: TrueMotion) -> None:
        """Be where the world has moved it."""
        x, y, heading = truth.pose.tolist()
        forward, lateral, yaw_rate = truth.twist.tolist()
        moved = self.robot.state_at(Pose((x, y), heading), Twist((forward, lateral), yaw_rate))
        self.state: tuple[float, ...] = tuple(float(value) for value in moved)

    def believe(self, place: Array) -> None:
        """Take itself to be at a place, (2,), m."""
        self._belief = float(place[0]), float(place[1])

    @property
    def believed(self) -> tuple[float, ...]:
        """Where it takes itself to be, in its own frame, which is the world's at the start."""
        return self._belief


@final
class WheeledWorld(World):
    """Robots that perceive one another with sensors and drive on wheels.

    Robots are bodies of a physical world; people who decide, and all others, are cylinders
    in it that go where they go. All happens at the instants of the smoother's step: a decision
    that is due between two of them is taken at the second. At time 0 robots stand, and have stood
    for the cascade's ``rest``; no one has seen them come.

    Parameters
    ----------
    cascade : what lies between the world and the controllers.
    settings : of the episode; its plant step is the smoother's. People exchange positions by its
        channel.

    Raises
    ------
    WideberthError : settings with a history or an error of localisation.
    """

    def __init__(self, cascade: SensingPipeline, settings: Settings) -> None:
        if settings.history or not settings.localisation.exact:
            raise WideberthError(
                "settings.history and settings.localisation stand for what the cascade's sensors "
                "do; set history: 0 and leave localisation out"
            )
        self._cascade, self._step = cascade, settings.plant_step
        self._exchange = ExchangedPositions(settings)
        self._physics: PhysicalWorld | None = None
        self._senses: dict[str, Senses] = {}
        self._bodies: dict[str, WheeledPlant] = {}
        self._now = -cascade.rest

    def plants(
        self,
        agents: Sequence[RobotAgent],
        others: Sequence[Bystander],
        polygons: Sequence[Polygon],
        seed: int,
    ) -> list[Plant]:
        """Build the physical world, and let it stand for the cascade's ``rest``."""
        for name in self._cascade.faults.robots:
            known = [agent.name for agent in agents if not agent.person]
            if name not in known:
                raise WideberthError(f"cascade.faults.robots: {unknown('robot', name, known)}")
        rng = np.random.default_rng((seed, len(agents)))
        robots, people = [], []
        for agent in agents:
            _check(agent, self._cascade.mechanical_body.radius)
            if agent.person:
                start = np.array(agent.path.points[0])
                people.append(PhysicalPerson(agent.name, start, agent.radius))
            else:
                robots.append(self._equipped(agent, rng))
        first = np.array([-self._cascade.rest])
        people += [
            PhysicalPerson(one.name, _present(one.at(first)[0], row), one.radius)
            for row, one in enumerate(others)
        ]
        scene = PhysicalScene(tuple(robots), tuple(people), tuple(polygons))
        self._physics = WORLDS[self._cascade.mechanics](scene, rng)
        plants: list[Plant] = [
            KinematicPlant.at_start(agent)
            if agent.person
            else WheeledPlant(agent.robot, self._physics.truth(agent.name))
            for agent in agents
        ]
        self._bodies = {
            agent.name: plant
            for agent, plant in zip(agents, plants, strict=True)
            if isinstance(plant, WheeledPlant)
        }
        steps = round(self._cascade.rest / self._step)
        for k in range(-steps, 0):
            self._advance(k * self._step, (k + 1) * self._step, agents, plants, others)
        return plants

    def newcomer(self, agent: RobotAgent) -> Plant:
        """Refuse a newcomer: bodies of the physical world are there from the start."""
        raise WideberthError(f"{agent.name} cannot appear in a physical world")

    def next_instant(self, now: float, wanted: float) -> float:
        """Return the next instant of the smoother."""
        return (round(now / self._step) + 1) * self._step

    def move(self, now: float, duration: float, around: Around) -> None:
        """Let the physics run, with what the smoothers say, and show the result to the senses."""
        agents = [driver.agent for driver in around.drivers]
        plants = [driver.plant for driver in around.drivers]
        end = now + duration
        fresh = self._advance(now, end, agents, plants, around.others)
        for driver in around.drivers:
            if driver.name in fresh:
                senses = self._senses[driver.name]
                for batch in senses.reports():
                    seen = senses.observation(batch, around.polygons)
                    driver.agent.controller.remember(seen)

    def observe(
        self, driver: Driver, time: float, tick: int, state: Array, around: Around
    ) -> Observation:
        """Return what a robot believes; people receive positions by the channel."""
        if driver.agent.person:
            return self._exchange.observe(driver, time, tick, state, around)
        senses = self._senses[driver.name]
        return senses.observation(senses.present(), around.polygons)

    def in_world(self, driver: Driver, plan: Plan) -> Plan:
        """Move a plan from the robot's own frame to the world's, with the names of bodies."""
        senses = self._senses.get(driver.name)
        if senses is None:
            return plan
        own = senses.estimator.at(senses.clock(plan.stamp)).pose
        motion = RigidMotion.between(own, self._world.truth(driver.name).pose)
        return motion.plan(plan, driver.agent.robot, senses.known)

    def perception(self) -> dict[str, PerceptionLog]:
        """Return what each robot has perceived."""
        return {
            name: replace(senses.log(), stops=self._bodies[name].stops(self._now))
            for name, senses in self._senses.items()
        }

    @property
    def senses(self) -> dict[str, Senses]:
        """What each robot perceives and believes."""
        return self._senses

    @property
    def lidar_mount(self) -> Array:
        """Where the LiDAR is on each robot, (3,), m and rad."""
        return np.array(self._cascade.lidar.mount)

    @property
    def _world(self) -> PhysicalWorld:
        assert self._physics is not None, "plants() builds it"
        return self._physics

    def _equipped(self, agent: RobotAgent, rng: np.random.Generator) -> PhysicalRobot:
        """Put sensors on a robot; a LiDAR that it does not need stays in the box."""
        cascade, start = self._cascade, start_pose(agent)
        phase = float(rng.uniform(0.0, 1.0 / cascade.lidar.rate))
        noise = np.random.default_rng(rng.integers(2**63))
        senses = Senses(agent.robot, cascade, agent.name, start, phase, noise)
        self._senses[agent.name] = senses
        sensors: tuple[Sensor, ...] = (cascade.encoders, cascade.imu)
        if senses.needs_scans:
            sensors = (replace(cascade.lidar, phase=phase), *sensors)
        grip = cascade.faults.of(agent.name).grip
        return PhysicalRobot(agent.name, cascade.mechanical_body, start, sensors, grip)

    def _advance(
        self,
        now: float,
        end: float,
        agents: Sequence[RobotAgent],
        plants: Sequence[Plant],
        others: Sequence[Bystander],
    ) -> set[str]:
        """Move all bodies, and return the names of the robots that have seen something new."""
        physics, middle = self._world, np.array([0.5 * (now + end)])
        self._push(now, end)
        for agent, plant in zip(agents, plants, strict=True):
            if isinstance(plant, WheeledPlant):
                # the yaw-rate loop reads the physical gyroscope, without what the faults add
                error = self._cascade.faults.of(agent.name).gyro_error(now)
                bias = self._senses[agent.name].gyro_bias - error
                physics.command(agent.name, plant.wanted(end), gyro_bias=bias)
            else:
                physics.move_person(agent.name, plant.position)
        for row, other in enumerate(others):
            physics.move_person(other.name, _present(other.at(middle)[0], row))
        physics.advance(end - now)
        self._now = end
        for agent, plant in zip(agents, plants, strict=True):
            if isinstance(plant, WheeledPlant):
                plant.follow(physics.truth(agent.name))
        due, fresh = physics.samples_due(), set()
        bodies = self._seen(end, agents, plants, others)
        for agent, plant in zip(agents, plants, strict=True):
            if not isinstance(plant, WheeledPlant):
                continue
            senses, found = self._senses[agent.name], physics.truth(agent.name)
            rest = tuple(one for one in bodies if one.name != agent.name)
            if senses.sense(TrueStage(end, found.pose, found.twist, rest), due[agent.name]):
                fresh.add(agent.name)
            plant.guard(physics.status(agent.name) or senses.stop, end)
            plant.believe(senses.estimator.at(senses.clock(end)).pose[:2])
        return fresh

    def _push(self, now: float, end: float) -> None:
        """Push who is pushed in this step."""
        push = self._cascade.faults.push
        if push is not None and now <= push[0] < end:
            for name in self._senses:
                if self._cascade.faults.of(name).push is not None:
                    self._world.push(name, push[1])

    def _seen(
        self,
        time: float,
        agents: Sequence[RobotAgent],
        plants: Sequence[Plant],
        others: Sequence[Bystander],
    ) -> list[TrueBody]:
        """Return where all bodies are at the end of a step."""
        found = []
        for agent, plant in zip(agents, plants, strict=True):
            pose = agent.robot.pose(plant.state)
            turn = RigidMotion(0.0 if pose.heading is None else float(pose.heading), np.zeros(2))
            linear = agent.robot.twist(plant.state, plant.control).linear
            velocity = turn.points(np.array(linear))
            found.append(TrueBody(agent.name, np.array(plant.position), velocity, agent.radius))
        instants = time + np.array([0.0, -_LITTLE])
        for one in others:
            now, before = one.at(instants)
            if np.isnan(now).any():
                continue
            before = np.where(np.isnan(before), now, before)
            found.append(TrueBody(one.name, now, (now - before) / _LITTLE, one.radius))
        return found


def _check(agent: RobotAgent, radius: float) -> None:
    """Refuse what cannot be in a physical world.

    Raises
    ------
    WideberthError : it respawns, begins at speed, or its model is smaller than its body.
    """
    if agent.respawn:
        raise WideberthError(
            f"{agent.name} comes anew after it has arrived; bodies cannot appear in a physical "
            "world; choose a scenario without respawn"
        )
    if agent.radius < radius - 1e-9 and not agent.person:
        raise WideberthError(
            f"the model of {agent.name} has a radius of {agent.radius:g} m and its body one of "
            f"{radius:g} m; give the robot radius: {radius:g}, or another body"
        )
    if agent.speed and not agent.person:
        raise WideberthError(
            f"{agent.name} moves at {agent.speed:g} m/s at time 0; robots with wheels begin at "
            "rest: give speed 0, and the speed as reference_speed"
        )


def _present(place: Array, row: int) -> Array:
    """Return a place, (2,), m; that of an absent body (NaN) is far away from all others."""
    return np.array([_ELSEWHERE + 10.0 * row, 0.0]) if np.isnan(place).any() else place


def start_pose(agent: RobotAgent) -> Array:
    """Return where an agent stands at the start of its path and looks along it, (3,)."""
    along = agent.path.direction(np.zeros(1))[0]
    return np.array([*agent.path.points[0], atan2(along[1], along[0])])
