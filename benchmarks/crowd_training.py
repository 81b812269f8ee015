"""Train the network of `social_attention` on simulated people, as the shipped one was trained.

    python benchmarks/crowd_training.py crowd.json

People and robot are those of `crowd_forecasts.py`, at other seeds, and in wider squares as well,
where turns are rarer. The file is used as `predictor: {saved: crowd.json}`.
"""

import sys
from collections.abc import Iterator, Mapping
from dataclasses import replace

import numpy as np
from crowd_forecasts import DT, NOISE, crowd, sampled

from wideberth.framework.plugins.config import save_plugin
from wideberth.framework.values.tracks import Tracks
from wideberth.predictors.core.density_network import Layer
from wideberth.predictors.core.social_network import SocialNetwork
from wideberth.predictors.social_attention import SocialAttention
from wideberth.simulation.log.episode_log import Episode

CELLS = {(5, 0.05): 250, (10, 0.1): 250, (20, 0.2): 150, (10, 0.02): 50, (20, 0.05): 50}
"""People and people per m^2 -> number of episodes."""
FIRST = 1000
"""Seed of the first episode of each cell; settings were chosen on seeds from 100 on, and errors
are reported of seeds from 200 on."""
DIGITS = 5
"""Significant digits of the numbers that are saved."""


def scene_of(episode: Episode, seed: int) -> Tracks:
    """Return an episode as measured; the robot, which comes first, is called so."""
    _, _, seen = sampled(episode, seed)
    ids = ("robot", *(one.name for one in episode.agents[1:]))
    radius = np.array([one.radius for one in episode.agents])
    return Tracks(seen, DT, ids, radius, np.tile(NOISE**2 * np.eye(2), (len(ids), 1, 1)))


def scenes(cells: Mapping[tuple[int, float], int]) -> Iterator[Tracks]:
    """Simulate all episodes."""
    for (persons, density), count in cells.items():
        for seed in range(FIRST, FIRST + count):
            yield scene_of(crowd(persons, density, seed)[0], seed)


def shortened(network: SocialNetwork) -> SocialNetwork:
    """Return a network whose numbers have few digits."""

    def few(numbers: tuple[float, ...]) -> tuple[float, ...]:
        return tuple(float(f"{number:.{DIGITS}g}") for number in numbers)

    layers = tuple(
        Layer(tuple(few(row) for row in layer.weight), few(layer.bias)) for layer in network.layers
    )
    centre, width = few(network.centre), few(network.width)
    return replace(network, centre=centre, width=width, layers=layers)


def main(
    path: str,
    cells: Mapping[tuple[int, float], int] = CELLS,
    predictor: SocialAttention | None = None,
) -> None:
    """Simulate, train and save."""
    begun = SocialAttention() if predictor is None else predictor
    fitted = begun.fit(list(scenes(cells)))
    assert fitted.fitted is not None
    save_plugin(path, "predictors", replace(fitted, fitted=shortened(fitted.fitted)))
    print(f"saved to {path}")


if __name__ == "__main__":
    main(sys.argv[1])
