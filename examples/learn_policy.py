# ruff: noqa: D103
"""Learn a policy by random search; a config then names it as  policy: learn_policy:policy."""

import gymnasium
import numpy as np

import wideberth.simulation.gym.environment as navigation

WEIGHTS = np.array([1.0, 0.0])  # of the pull to the goal and the push of whoever is near
def policy(seen):
    apart = np.linalg.norm(seen["positions"], axis=1) - seen["radii"] - 0.3
    near = seen["present"] / np.maximum(apart, 0.05) ** 2
    way = WEIGHTS[0] * seen["goal"] - WEIGHTS[1] * near @ seen["positions"]
    return way / max(1.0, np.linalg.norm(way))
def total(weights, environment, seeds, reward=0.0):
    WEIGHTS[:] = weights
    for seed in seeds:
        (seen, _), over = environment.reset(seed=seed), False
        while not over:
            seen, gained, *ends, _ = environment.step(policy(seen))
            reward, over = reward + gained / len(seeds), any(ends)
    return reward
if __name__ == "__main__":
    environment = gymnasium.make(navigation.ID,
        scenario={"type": "crossing_field", "walkers": 8, "reach": 5.0},
        robot={"type": "holonomic_velocity", "radius": 0.3, "max_speed": 1.0})  # fmt: skip
    tried = np.random.default_rng(0).uniform(0.0, [2.0, 1.0], (6, 2))
    best = max(tried, key=lambda weights: total(weights, environment, range(3)))
    for weights in ([1.0, 0.0], best):  # straight to the goal, and what was learnt
        print(np.round(weights, 2), "is worth", total(weights, environment, range(3, 9)))
