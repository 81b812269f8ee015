"""Attention network from a person's way and that of the others to the Gaussian of his future.

Everything is told in the person's own frame (x along his heading) and answered in that frame, so
that the answer turns and shifts with the world whatever the weights are; neighbours enter through
sums, so that their order does not matter. ``xp`` is the array library: NumPy, or JAX in training.
"""

from dataclasses import dataclass
from functools import cached_property
from itertools import pairwise
from typing import Any, final

import numpy as np

from ...framework.values.arrays import Array, positive, whole
from ...framework.values.errors import WideberthError
from .density_network import (
    FEATURES,
    Frames,
    Layer,
    Modes,
    decode,
    features,
    forward,
    in_world,
    output_count,
)

HEADS = 4
"""Of the attention: each has scores of its own."""
WIDTH = 8
"""Numbers that each head passes on."""
PAIR_HIDDEN = 40
"""Width of the tanh layer that sees a pair."""
AHEAD = (0.0, 1.0, 2.0, 3.0)
"""s from now, when the places of two people are compared: along straight lines, and along its
plan for the robot."""
RANGE = 15.0
"""m; who is farther off is not seen, and before that he fades."""
BLUNT = 1.0
"""m and m/s; larger distances and velocities are told more and more coarsely."""
CLOSE = (1.0, 0.25)
"""m between two surfaces at which closeness is 1/e, at all times and, finer, now."""
PAIR_FEATURES = 3 * len(AHEAD) + 9
"""Numbers that describe a pair."""
PAIR_LAYERS = 2
"""The first layers of the network see pairs, the others see a person and his company."""


@dataclass(frozen=True, eq=False)
class People:
    """What the network is told of persons, and of those around them.

    Leading axes (..., ) are persons, or persons and their neighbours.

    Attributes
    ----------
    courses : (..., len(AHEAD), 2), m, places at the times `AHEAD`.
    velocity : (..., 2), m/s, mean of the newest velocities, see `frames`.
    bend : (..., 2), m/s, newest velocity less that mean.
    radius : (...,), m.
    robot : (...,), 1 for the robot, 0 for people.
    """

    courses: Any
    velocity: Any
    bend: Any
    radius: Any
    robot: Any


def blunted(xp: Any, vectors: Any) -> Any:
    """Return v / (1 + |v|), (..., 2): the direction, and a length below 1."""
    size = xp.sqrt((vectors**2).sum(axis=-1, keepdims=True))
    return vectors / (BLUNT + size)


def straight(xp: Any, velocity: Any, radius: Any) -> People:
    """Return people (B,) who walk straight on from the origin, as `pairs` wants them.

    Parameters
    ----------
    velocity : (B, 2), m/s. radius : (B,), m.
    """
    courses = xp.asarray(AHEAD)[:, None] * velocity[:, None]
    nothing = 0.0 * velocity
    return People(courses, velocity, nothing, radius, nothing[:, 0])


def pairs(xp: Any, own: People, others: People, turn: Any, certain: Any) -> tuple[Any, Any]:
    """Describe every neighbour of every person.

    Of each: at the times `AHEAD` the way to him, blunted, and the closeness exp(-gap / 1 m) of
    both surfaces; the same now, finer; his velocity and the difference from the own one, blunted;
    his bend; the person's own speed, blunted; and whether he is the robot. Vectors are in the
    person's frame, and shrink to 0 where he has no heading.

    Parameters
    ----------
    own : B persons. others : (B, M) neighbours.
    turn : (B, 2, 2), takes vectors of the world into the person's frame.
    certain : (B,), trust in the heading.

    Returns
    -------
    (B, M, PAIR_FEATURES), and the share (B, M) of each who is seen: (1 - (d / RANGE)^2)^2 within
    `RANGE`, and 0 beyond.
    """
    trusted = xp.sqrt(certain)[:, None, None] * xp.swapaxes(turn, 1, 2)
    apart = others.courses - own.courses[:, None]
    distance = xp.sqrt((apart**2).sum(axis=-1))
    gap = xp.maximum(distance - (own.radius[:, None] + others.radius)[..., None], 0.0)
    count, most, times = distance.shape
    ways = blunted(xp, apart).reshape(count, most * times, 2) @ trusted
    relative = blunted(xp, others.velocity - own.velocity[:, None])
    vectors = [relative, blunted(xp, others.velocity), blunted(xp, others.bend)]
    told = [ways.reshape(count, most, 2 * times), *(one @ trusted for one in vectors)]
    told += [xp.exp(-gap / CLOSE[0]), xp.exp(-gap[..., :1] / CLOSE[1])]
    speed = xp.sqrt((own.velocity**2).sum(axis=-1))
    speed = xp.broadcast_to((speed / (BLUNT + speed))[:, None], (count, most))
    told += [xp.stack([speed, others.robot], axis=-1)]
    away = xp.minimum(distance[..., 0] / RANGE, 1.0)
    return xp.concatenate(told, axis=-1), (1.0 - away**2) ** 2


def attend(xp: Any, layers: Any, told: Any, seen: Any) -> Any:
    """Sum up the neighbours by attention, (B, HEADS (WIDTH + 1)).

    a_hj = seen_j exp(s_hj),   A_h = sum_j a_hj,   y_h = sum_j a_hj v_hj / (1 + A_h)

    with the scores s (bounded) and the values v of a perceptron that sees one pair. Told are all
    y_h, then log(1 + A_h). Without neighbours all is 0.

    Parameters
    ----------
    layers : of the perceptron.
    told, seen : as `pairs` returns them.
    """
    out = forward(xp, layers, told)
    attention = xp.exp(5.0 * xp.tanh(0.2 * out[..., :HEADS])) * seen[..., None]
    values = xp.tanh(out[..., HEADS:]).reshape(*out.shape[:2], HEADS, WIDTH)
    total = attention.sum(axis=1)
    pooled = (attention[..., None] * values).sum(axis=1) / (1.0 + total)[..., None]
    return xp.concatenate([pooled.reshape(len(out), HEADS * WIDTH), xp.log1p(total)], axis=1)


def outputs(xp: Any, layers: Any, inputs: Any, told: Any, seen: Any) -> Any:
    """Return the network's outputs, (B, `output_count` of one mode).

    Parameters
    ----------
    layers : pairs of weight and bias; the first `PAIR_LAYERS` see pairs.
    inputs : (B, I), what is known of each person alone.
    told, seen : as `pairs` returns them.
    """
    company = attend(xp, layers[:PAIR_LAYERS], told, seen)
    return forward(xp, layers[PAIR_LAYERS:], xp.concatenate([inputs, company], axis=1))


@final
@dataclass(frozen=True)
class SocialNetwork:
    """A trained network as plain numbers, so that a config can contain it.

    Attributes
    ----------
    dt : s between the positions that it sees.
    observed : how many positions it sees of each person.
    horizon : s, how far it was trained to look ahead.
    scale : m/s, the unit of speed.
    centre, width : of each input of a person; the network sees (input - centre) / width.
    layers : see `Layer` and `outputs`.

    Raises
    ------
    WideberthError : sizes that do not fit together.
    """

    dt: float
    observed: int
    horizon: float
    scale: float
    centre: tuple[float, ...]
    width: tuple[float, ...]
    layers: tuple[Layer, ...]

    def __post_init__(self) -> None:
        for name in ("dt", "horizon", "scale"):
            positive(f"social_network.{name}", getattr(self, name))
        whole("social_network.observed", self.observed, least=3)
        alone = 2 * (self.observed - 1) + FEATURES
        pair, rest = self.layers[:PAIR_LAYERS], self.layers[PAIR_LAYERS:]
        company = HEADS * (WIDTH + 1)
        fits = len(pair) == PAIR_LAYERS and _fit(pair, PAIR_FEATURES, company)
        fits = fits and _fit(rest, alone + company, output_count(1))
        if not (fits and len(self.centre) == len(self.width) == alone):
            sizes = [(len(layer.weight), len(layer.bias)) for layer in self.layers]
            raise WideberthError(
                f"social_network has layers of {sizes} numbers; wanted {PAIR_FEATURES} to "
                f"{company} for pairs, then {alone + company} to {output_count(1)} for "
                f"{self.observed} positions, and rows, centre and width of the same lengths: fit "
                "it again"
            )

    @cached_property
    def arrays(self) -> list[tuple[Array, Array]]:
        """Layers as arrays."""
        return [(np.array(layer.weight), np.array(layer.bias)) for layer in self.layers]

    def foresee(self, velocities: Array, own: Frames, me: People, others: People) -> Modes:
        """Return the one mode of each person's future.

        Parameters
        ----------
        velocities : (O, observed - 1, 2), m/s, oldest first.
        own : their frames.
        me : the persons. others : (O, M), around each of them; places that are NaN are nobody.
        """
        alone = (features(velocities, own, self.scale) - np.array(self.centre)) / self.width
        nobody = ~np.isfinite(others.courses[..., 0, 0])
        courses = np.where(nobody[..., None, None], 0.0, others.courses)
        others = People(courses, others.velocity, others.bend, others.radius, others.robot)
        told, seen = pairs(np, me, others, own.turn, own.certain)
        raw = outputs(np, self.arrays, alone, told, np.where(nobody, 0.0, seen))
        decoded = decode(np, raw, own.certain, 1, self.scale * self.horizon)
        return in_world(*decoded, own, self.horizon)


def _fit(layers: tuple[Layer, ...], before: int, after: int) -> bool:
    """Whether layers take ``before`` numbers to ``after``."""
    sizes = [before, *(len(layer.bias) for layer in layers)]
    return sizes[-1] == after and all(
        len(layer.weight) == rows and all(len(row) == columns for row in layer.weight)
        for layer, (rows, columns) in zip(layers, pairwise(sizes), strict=True)
    )
