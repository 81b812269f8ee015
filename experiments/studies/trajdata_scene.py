"""Reader of the scenes of trajdata, which reads many datasets of other people's."""

from collections.abc import Mapping
from importlib import import_module
from typing import Any

import numpy as np

from ...framework.values.errors import WideberthError
from ...predictors.data.recordings import Recording, gridded

PERSON = "PEDESTRIAN"
"""Name of the type of agents that are people, in trajdata."""


def read_trajdata(
    data: str,
    folders: Mapping[str, str],
    *,
    scene: int = 0,
    dt: float | None = None,
    minimum_samples: int = 8,
    longest_gap: float = 1.0,
) -> Recording:
    """Read the people of one scene of a dataset that trajdata knows.

    trajdata is not among the extras, since it brings PyTorch: ``pip install trajdata``.

    Parameters
    ----------
    data : name of the dataset, or of a part of it, as in ``desired_data`` of trajdata:
        "eupeds_eth", "sdd-train".
    folders : name of the dataset -> its folder, as in ``data_dirs`` of trajdata.
    scene : which one, counted from 0.
    dt : s between rows; by default the dataset's. trajdata interpolates to a shorter one.
    minimum_samples, longest_gap : as in `wideberth.predictors.data.recordings.read_tracks`.

    Raises
    ------
    WideberthError : trajdata is not installed or refuses the dataset, no such scene, or no people
        in it.

    References
    ----------
    Ivanovic et al., "trajdata: A unified interface to multiple human trajectory datasets",
    NeurIPS Datasets and Benchmarks 2023
    """
    try:
        trajdata = import_module("trajdata")
    except ImportError as error:
        raise WideberthError(
            f"scenes of trajdata need it, which cannot be imported ({error}): pip install "
            "trajdata; recordings of `frame id x y`, THÖR-MAGNI and JRDB are read without it"
        ) from error
    try:
        dataset = trajdata.UnifiedDataset(
            desired_data=[data], data_dirs=dict(folders), desired_dt=dt, num_workers=0
        )
        count = dataset.num_scenes()
    except Exception as error:  # what other people's readers raise is theirs
        raise WideberthError(
            f"trajdata cannot read {data!r}: {error}; check the folders"
        ) from error
    if not 0 <= scene < count:
        raise WideberthError(f"scene is {scene}; {data!r} has scenes 0 to {count - 1}")
    found = dataset.get_scene(scene)
    return _recording(
        found, dataset.cache_class(dataset.cache_path, found), minimum_samples, longest_gap
    )


def _recording(scene: Any, states: Any, minimum_samples: int, longest_gap: float) -> Recording:
    """Return the people of a scene, whose states trajdata's cache gives by agent and time step."""
    people = [agent for agent in scene.agents if agent.type.name == PERSON]
    if not people:
        raise WideberthError(
            f"{scene} has no people: its {len(scene.agents)} agents are of other types"
        )
    steps = {agent.name: range(agent.first_timestep, agent.last_timestep + 1) for agent in people}
    places = {
        name: [np.asarray(states.get_raw_state(name, step).position) for step in some]
        for name, some in steps.items()
    }
    others = len(scene.agents) - len(people)
    return gridded(
        {name: [step * scene.dt for step in some] for name, some in steps.items()},
        places,
        scene.dt,
        bridge=scene.dt,
        minimum_samples=minimum_samples,
        longest_gap=longest_gap,
        notes=[f"left out: {others} agents that are not people"] * bool(others),
    )
