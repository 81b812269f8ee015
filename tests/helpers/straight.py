"""A controller that goes straight to its goal and keeps all that it is shown."""

from dataclasses import dataclass

import numpy as np

from wideberth.framework.controller import Controller
from wideberth.framework.values.motion import Command


@dataclass(eq=False)
class Straight(Controller):
    """Goes straight to its goal and keeps all that it is shown."""

    speed: float = 1.0
    period: float = 0.25

    def reset(self):
        self.seen = []

    def set_path(self, path):
        self.goal = path.goal

    def remember(self, observation):
        pass

    @property
    def last_plan(self):
        return None

    @property
    def first_seen(self):
        """Names of those whom it saw at its first decision."""
        return tuple(sorted(one.ident for one in self.seen[0].detections))

    def command(self, observation):
        self.seen.append(observation)
        if observation.truth is not None:
            dict(observation.truth.positions)  # people's is simulated when it is read
        way = self.goal - observation.state[:2]
        far = np.linalg.norm(way)
        scale = min(self.speed, far / self.period) / max(far, 1e-9)
        return Command((float(scale * way[0]), float(scale * way[1])))
