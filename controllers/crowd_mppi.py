"""Model predictive path integral control among people who react to each sample."""

from dataclasses import dataclass, field
from typing import ClassVar, final

import numpy as np
from numpy.typing import NDArray

from ..framework.control.command_limits import attained
from ..framework.metrics.episode import approach
from ..framework.mpc.fallback.rollout import drive_along
from ..framework.people.models import CircularForce, PersonModel, Reciprocal, Straight, Walkers
from ..framework.people.reactions import reactions
from ..framework.people.walls import WallField
from ..framework.values.arrays import Array, whole
from ..framework.values.motion import Command, Observation, Twist
from .reactive import Reactive
from .steering import FAST, SLOWING

CORRELATION = 0.8
"""Of the noise on a twist with that on the one a step earlier: samples are smooth."""
NEAREST = 20
"""People who are rolled out; who is farther away goes straight on, so that work is bounded."""
MOST_PARTS = 8
"""Of a step at which walls are looked at: only a state beyond all limits would need more."""
BACKWARDS = 0.5
"""Share of its speed at which a robot with a heading is tried in reverse."""


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
    between two ways round somebody, the best sample takes its place. The cost is

        J = mean_t |p_t - c| + C (T + 1 - t_touch) / T + Q dt sum_t sum_i max(0, 1 - gap_ti / m)^2

    with the point c ahead on the path; t_touch is the first step with a contact (none costs
    nothing), and gaps are between the surfaces of robot and person or wall: the smallest within a
    step, of walls at points a radius apart.

    What a person wants is not told: it is the mean velocity of the last while, u <- u + (1 -
    exp(-period / memory)) (v - u). Somebody whom the robot holds up is soon believed to want that.
    The `NEAREST` people are rolled out, the others go straight on. Nothing is promised: no sample
    may be free, and people may do something else.

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
        walls, radius = WallField(observation.polygons), self.robot.radius
        order = np.argsort(np.linalg.norm(people.place - ways[0, 0], axis=1), kind="stable")
        near, far = _some(people, order[:NEAREST]), _some(people, order[NEAREST:])
        others = reactions(self.model, near, ways, radius, walls, self.dt)
        times = self.dt * np.arange(self.steps + 1)[:, None]
        straight = far.place[:, None] + times * far.wanted[:, None]
        met = [
            approach(ways[:, None], places) - radius - some.radius[:, None]
            for some, places in ((near, others), (far, straight))
        ]
        gaps = np.concatenate([*met, self._beside(ways, walls)], axis=1)  # (K, N + W, T)
        touched = gaps.min(axis=1, initial=np.inf) < 0.0
        left = np.where(touched.max(axis=1), self.steps - touched.argmax(axis=1), 0)
        close = (np.clip(1.0 - gaps / self.margin, 0.0, None) ** 2).sum(axis=(1, 2))
        off = np.linalg.norm(ways[:, 1:] - carrot, axis=-1).mean(axis=1)
        return np.asarray(
            off + self.contact * left / self.steps + self.closeness * self.dt * close
        )

    def _beside(self, ways: Array, walls: WallField) -> Array:
        """Return the gaps to each wall in each step, (K, W, T), m; at points a radius apart."""
        moves = np.diff(ways, axis=1)
        longest = float(np.linalg.norm(moves, axis=-1).max(initial=0.0))
        parts = int(np.clip(np.ceil(longest / self.robot.radius), 1, MOST_PARTS))
        shares = np.arange(1.0, parts + 1)[:, None] / parts
        places = ways[:, :-1, None] + shares * moves[:, :, None]  # (K, T, parts, 2)
        shape = *places.shape[:3], len(walls.polygons)
        gaps = walls.beside(places.reshape(-1, 2))[..., 0].reshape(shape).min(axis=2)
        return np.asarray(np.moveaxis(gaps, -1, 1) - self.robot.radius)

    def _people(self) -> Walkers:
        """Return everybody known, with what they are believed to want."""
        ids, places, velocities, radii = self._neighbours.now()
        share = 1.0 - np.exp(-self.period / self.memory)
        before = self._wanted
        self._wanted = {
            name: velocity + (1.0 - share) * (before.get(name, velocity) - velocity)
            for name, velocity in zip(ids, velocities, strict=True)
        }
        wanted = np.array(list(self._wanted.values())).reshape(-1, 2)
        return Walkers(places, velocities, wanted, radii)

    def _drawn(self, state: Array, fastest: float) -> Array:
        """Draw the samples, (K, T, 3); the first is the last decision's, the second stands."""
        rng, old, fresh = self._rng, self.samples // 2, self.samples - self.samples // 2
        scale = self._scale(state, fastest)
        noise = rng.standard_normal((old, self.steps, 3))
        for row in range(1, self.steps):
            kept = np.sqrt(1.0 - CORRELATION**2)
            noise[:, row] = CORRELATION * noise[:, row - 1] + kept * noise[:, row]
        about = self._shifted() + self.spread * scale * noise
        about[0] = self._shifted()
        about[1] = 0.0
        held = rng.uniform(-1.0, 1.0, (fresh, 2, 3))
        if self.robot.pose(tuple(state)).heading is not None:
            held[..., 0] = 0.5 * (1.0 + BACKWARDS) * held[..., 0] + 0.5 * (1.0 - BACKWARDS)
        changed = rng.integers(1, self.steps, fresh)
        later = np.arange(self.steps) >= changed[:, None]
        anew = scale * np.where(later[..., None], held[:, 1:], held[:, :1])
        drawn = np.concatenate([about, anew])
        speed = np.hypot(drawn[..., 0], drawn[..., 1])
        drawn[..., :2] *= np.minimum(1.0, fastest / np.maximum(speed, 1e-9))[..., None]
        return drawn

    def _scale(self, state: Array, fastest: float) -> Array:
        """Return the largest twist, (3,): speeds along and across, m/s, and yaw rate, rad/s."""
        if self.robot.pose(tuple(state)).heading is None:
            return np.array([fastest, fastest, 0.0])
        turning = attained(self.robot, state, [Twist((fastest, 0.0), FAST)])[0, 2]
        return np.array([fastest, 0.0, abs(float(turning))])

    def _shifted(self) -> Array:
        """Return the last decision's sequence as seen one period later, (T, 3)."""
        rows = np.arange(self.steps) * self.dt
        seen = np.minimum(rows + self.period, rows[-1])
        return np.stack([np.interp(seen, rows, column) for column in self._last.T], axis=1)


def _some(people: Walkers, rows: NDArray[np.intp]) -> Walkers:
    """Return some of the people."""
    return Walkers(*(getattr(people, name)[rows] for name in vars(people)))
