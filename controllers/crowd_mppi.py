"""Model predictive path integral control among people who react to each sample."""

from dataclasses import dataclass, field
from typing import ClassVar, final

import numpy as np

from ..framework.mpc.fallback.rollout import drive_along
from ..framework.people.models import CircularForce, PersonModel, Reciprocal, Straight, Walkers
from ..framework.people.walls import WallField
from ..framework.people.ways import Neighbourhood, WayCost, averaged, drawn
from ..framework.values.arrays import Array, whole
from ..framework.values.motion import Command, Observation
from .reactive import Reactive
from .steering import SLOWING


@final
@dataclass(eq=False)
class CrowdMppi(Reactive):
    """Samples sequences of twists, rolls people out beside each, and drives their weighted mean.

    Half of the K samples are the last decision's sequence U with noise on it; the others hold one
    random twist and then another, so that ways round are found where U is stuck. The robot's own
    model drives along each. Beside each way all people are rolled out by ``model``: they see the
    robot of that sample and make way for it, or do not, see
    `wideberth.framework.people.reactions.reactions`. The mean has the weights

        U = sum_k w_k U_k,   w_k ~ exp(-(J_k - min J) / lambda)

    and its first twist is commanded. Where the mean costs more than the best sample, as it may
    between two ways round somebody, the best sample takes its place. The cost is that of
    `wideberth.framework.people.ways.WayCost`, with the point c ahead on the path.

    What a person wants is not told: it is the mean velocity of the last while, u <- u + (1 -
    exp(-period / memory)) (v - u). Somebody whom the robot holds up is soon believed to want that.
    The nearest people are rolled out (`wideberth.framework.people.ways.NEAREST`), the others go
    straight on. Nothing is promised: no sample may be free, and people may do something else.

    Parameters
    ----------
    robot, period, reference_speed, look_ahead, forget : as in `Reactive`.
    model : the rule of the people; `Straight` makes way for nobody.
    samples : K.
    steps, dt : T and s, of each sample.
    temperature : lambda, m.
    spread : deviation of the noise over the robot's speed and yaw rate.
    memory : s, over which the wanted velocity is averaged.
    contact, closeness, margin : C, m; Q, m/s; m, m.
    seed : of the samples, with the place of the first decision.

    Raises
    ------
    WideberthError : a number out of range, or a robot that moves in space.

    References
    ----------
    G. Williams et al., Information theoretic MPC for model-based reinforcement learning, ICRA
    (2017), for the weights; samples, cost and the people in them are ours.
    """

    zero_allowed: ClassVar[frozenset[str]] = frozenset({"contact", "closeness", "seed"})
    reference: ClassVar[str] = "williams2017information"

    look_ahead: float = 3.0
    reference_speed: float = 1.0
    period: float = 0.2
    model: Straight | CircularForce | Reciprocal | PersonModel = field(
        default_factory=CircularForce
    )
    samples: int = 400
    steps: int = 16
    dt: float = 0.25
    temperature: float = 0.05
    spread: float = 0.4
    memory: float = 1.0
    contact: float = 100.0
    closeness: float = 1.0
    margin: float = 0.3
    seed: int = 0

    def __post_init__(self) -> None:
        whole("CrowdMppi.samples", self.samples, least=4)
        whole("CrowdMppi.steps", self.steps, least=2)
        whole("CrowdMppi.seed", self.seed, least=0)
        super().__post_init__()

    def decide(self, observation: Observation, place: Array) -> Command:
        """Return the first twist of the weighted mean of all samples."""
        found = self._guide.ahead(place, self.look_ahead)
        assert found is not None  # seen to by `command`
        carrot, way = found
        if self._velocity is None:  # the first decision after `reset`
            where = np.frombuffer(np.ascontiguousarray(place).tobytes(), dtype=np.uint32)
            self._rng = np.random.default_rng([self.seed, *where.tolist()])
            self._last = np.zeros((self.steps, 3))
            self._wanted: dict[str, Array] = {}
        people = self._people()
        twists = self._drawn(observation.state, min(self.reference_speed, way / SLOWING))
        cost = self.cost(observation, people, carrot, twists)
        weight = np.exp(-(cost - cost.min()) / self.temperature)
        mean = np.einsum("k,ktd->td", weight / weight.sum(), twists)
        both = np.stack([mean, twists[int(cost.argmin())]])
        self._last = both[int(self.cost(observation, people, carrot, both).argmin())]
        vx, vy, omega = self._last[0].tolist()
        self._velocity = self._last[0, :2]
        return Command((vx, vy), omega)

    def cost(
        self, observation: Observation, people: Walkers, carrot: Array, twists: Array
    ) -> Array:
        """Return J of each sequence (K, T, 3) of twists, (K,), m.

        Parameters
        ----------
        observation : the robot's state and the walls.
        people : as they are now.
        carrot : c, (2,), m.
        twists : m/s and rad/s.
        """
        states = drive_along(self.robot, observation.state, twists, self.dt)
        ways = self.robot.pose(tuple(np.moveaxis(states, -1, 0))).points()
        around = Neighbourhood(self.model, people, WallField(observation.polygons))
        price = WayCost(self.contact, self.closeness, self.margin)
        return price.of(around, ways, self.robot.radius, carrot, self.dt)

    def _people(self) -> Walkers:
        """Return everybody known, with what they are believed to want."""
        ids, places, velocities, radii = self._neighbours.now()
        before = {**dict(zip(ids, velocities, strict=True)), **self._wanted}
        self._wanted = {
            name: averaged(before[name], velocity, self.period, self.memory)
            for name, velocity in zip(ids, velocities, strict=True)
        }
        wanted = np.array(list(self._wanted.values())).reshape(-1, 2)
        return Walkers(places, velocities, wanted, radii)

    def _drawn(self, state: Array, fastest: float) -> Array:
        """Draw the samples, (K, T, 3); the first is the last decision's, the second stands."""
        about = self._shifted()
        return drawn(self.robot, state, self._rng, about, fastest, self.spread, self.samples)

    def _shifted(self) -> Array:
        """Return the last decision's sequence as seen one period later, (T, 3)."""
        rows = np.arange(self.steps) * self.dt
        seen = np.minimum(rows + self.period, rows[-1])
        return np.stack([np.interp(seen, rows, column) for column in self._last.T], axis=1)
