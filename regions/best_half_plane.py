"""The half-plane chance constraint with the best line: the exact sum at level z."""

from dataclasses import dataclass
from typing import ClassVar, final

from ..framework.region import Guarantee, Relation
from . import gaussian
from .minkowski_sum import BlendedSum


@final
@dataclass(frozen=True)
class BestHalfPlane(BlendedSum, gaussian.LineLevel):
    """`MinkowskiSum` sized by the collision risk: ellipse of level z = Phi^-1(1 - eps) plus disc.

    The obstacle reaches a disc beyond the line with normal n with probability at most
    Phi(-(n . d - margin) / sqrt(n^T Sigma n)). Its minimum over n is Phi(-m), and m is the level
    at which the disc touches the ellipse. So {p : min_n ... > eps} is the exact sum at the level
    z = Phi^-1(1 - eps); geometry, constraint and auxiliary are those of `MinkowskiSum`.

    ``tail`` is eps, the collision risk asked for, not the content of the ellipse; risks above
    1/2 give z = 0, the disc. Guarantee CONTENT: the risk outside is at most ``tail``. Relation
    INNER, to the sum of content 1 - eps: z is below the s of that content, since
    Phi(-s) < exp(-s^2 / 2) and, in 3-D, s is larger still (1.645 against 2.448 at eps = 0.05).
    It lies inside `HalfPlane`, whose line is one of those it chooses from.

    References
    ----------
    As `HalfPlane`, with the normal optimised.
    """

    relation: ClassVar[Relation] = Relation.INNER
    guarantee: ClassVar[Guarantee] = Guarantee.CONTENT
    dimensions: ClassVar[tuple[int, ...]] = (2, 3)
    reference: ClassVar[str] = "perram1985"
