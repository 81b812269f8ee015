"""A region of your own: the disc around the content ellipse, simple and too large."""
# ruff: noqa: D101, E731
from dataclasses import dataclass

import numpy as np

from wideberth.framework.region import Constraint, Guarantee, Region, Relation
from wideberth.framework.testing import check_region

radius = lambda p, level: level * p[..., 2] + p[..., 3]
circle = lambda n: np.exp(2j * np.pi * np.arange(n) / n)[:, None].view(float)


@dataclass(frozen=True)
class Disc(Region):
    relation, guarantee, parameter_count = Relation.OUTER, Guarantee.CONTENT, lambda *_: 4
    parameters = lambda _, o, margin: np.stack(np.broadcast_arrays(
        *np.moveaxis(o.mean, -1, 0), np.linalg.norm(o.covariance, 2, (-2, -1)) ** 0.5, margin
    ), axis=-1)  # fmt: skip
    constraint = lambda _, pose, p, s, auxiliary: Constraint((np.log(1e-12 + sum(
        (x - p[i]) ** 2 for i, x in enumerate(pose.position)) / (s * p[2] + p[3] + 1e-9) ** 2),))
    contains = lambda _, x, p, s: np.linalg.norm(x - p[..., :2], axis=-1) < radius(p, s)
    boundary = lambda _, p, level, count: p[:2] + radius(p, level) * circle(count)
    area = lambda _, p, level: np.pi * radius(p, level) ** 2
    level = lambda _, tail, dimension=2: np.sqrt(-2 * np.log(tail))
    tail = lambda _, level, dimension=2: np.exp(-(level**2) / 2)

if __name__ == "__main__":
    check_region(Disc())
    print("Disc keeps every law; name it in a config as  type: my_region:Disc")
