"""Learn a policy by random search in the Gymnasium environment.

The policy adds a pull to the goal and a push away from obstacles; the search chooses the two
weights. The script prints what it found and draws the rewards into ``learn_policy.png``. A config
then names the policy as a controller: ``{type: policy, policy: learn_policy:policy, ...}``. The
policy takes the weights `LEARNT`: put there what the script prints.
"""

from dataclasses import dataclass

import gymnasium
import matplotlib.pyplot as plt
import numpy as np

WORLD = "wideberth.simulation.gym:wideberth/Navigation-v0"  # package that registers it : name
ROBOT_RADIUS = 0.3  # m
NEAREST = 0.05  # m, the push does not grow below this clearance
SCENARIO = {"type": "crossing_field", "walkers": 8, "reach": 5.0}
ROBOT = {"type": "holonomic_velocity", "radius": ROBOT_RADIUS, "max_speed": 1.0}


@dataclass(frozen=True)
class Weights:
    """Parameters of the policy.

    Attributes
    ----------
    pull : weight of the way to the goal.
    push : weight of the push away from obstacles.
    """

    pull: float
    push: float


STRAIGHT = Weights(pull=1.0, push=0.0)
LEARNT = Weights(pull=1.21, push=0.73)


def velocity(seen, weights):
    """Return the velocity as a share of the largest speed, (2,).

    Each obstacle at the position p relative to the robot, with the clearance c, pushes by
    -push p / c^2.
    """
    clearance = np.linalg.norm(seen["positions"], axis=1) - seen["radii"] - ROBOT_RADIUS
    nearness = seen["present"] / np.maximum(clearance, NEAREST) ** 2
    way = weights.pull * seen["goal"] - weights.push * nearness @ seen["positions"]
    return way / max(1.0, np.linalg.norm(way))


def policy(seen):
    """Return the velocity that a config's ``policy: learn_policy:policy`` drives."""
    return velocity(seen, LEARNT)


def mean_reward(weights, environment, seeds):
    """Return the total reward of an episode, averaged over the seeds."""
    total = 0.0
    for seed in seeds:
        seen, _ = environment.reset(seed=seed)
        over = False
        while not over:
            seen, reward, terminated, truncated, _ = environment.step(velocity(seen, weights))
            total += reward
            over = terminated or truncated
    return total / len(seeds)


def random_search(environment, tries, seeds):
    """Return the weights that were tried and their mean rewards."""
    rng = np.random.default_rng(0)
    tried = [Weights(*pair) for pair in rng.uniform(0.0, [2.0, 1.0], (tries, 2)).round(2).tolist()]
    return tried, [mean_reward(weights, environment, seeds) for weights in tried]


def draw(tried, rewards, file):
    """Draw the reward of each pair of weights."""
    figure, axes = plt.subplots(figsize=(5, 4))
    places = np.array([(weights.pull, weights.push) for weights in tried])
    dots = axes.scatter(*places.T, c=rewards, s=80, cmap="viridis", edgecolor="k")
    axes.set(xlabel="pull to the goal", ylabel="push away from obstacles")
    figure.colorbar(dots, label="mean reward of an episode")
    figure.savefig(file, dpi=150, bbox_inches="tight")


def learn(tries=6, learning=range(3), testing=range(3, 9)):
    """Search on some seeds, and report the reward on others."""
    environment = gymnasium.make(WORLD, scenario=SCENARIO, robot=ROBOT)
    tried, rewards = random_search(environment, tries, learning)
    best = tried[int(np.argmax(rewards))]
    for name, weights in (("straight to the goal", STRAIGHT), ("learnt", best)):
        reward = mean_reward(weights, environment, testing)
        print(f"{name}: {weights}, mean reward {reward:.2f}")
    draw(tried, rewards, "learn_policy.png")


if __name__ == "__main__":
    learn()
