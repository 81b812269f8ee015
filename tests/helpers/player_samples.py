"""An episode for the tests of the player, and what its script makes of the numbers."""

import base64
import json
import zlib

import numpy as np

from wideberth.experiments.report.player import LENGTH
from wideberth.framework.values.forecast import Forecast
from wideberth.framework.values.path import Path
from wideberth.framework.values.plan import Breach, BreachKind, Plan, Rung, Status
from wideberth.framework.values.polygon import Polygon
from wideberth.simulation.log.episode_log import AgentLog, CommandLog, Episode

TIMES = np.unique(np.concatenate([np.arange(0.0, 6.001, 0.02), [0.3141, 1.7]]))
STAMPS = np.array([0.3141, 1.7, 2.9])
STEPS = 8
NASTY = "</script><script>alert(1)</script>"


def forecast(size: int = 2) -> Forecast:
    mean = np.cumsum(np.full((1, 2, STEPS, size), 0.1), axis=2)
    root = np.eye(size) + 0.5 * np.tri(size, k=-1)
    covariance = np.arange(1, STEPS + 1)[:, None, None] * 0.05 * (root @ root.T)
    weight = np.array([[1.0, 0.0]])  # the second mode only fills up the array
    full = np.broadcast_to(covariance, (1, 2, STEPS, size, size))
    return Forecast(mean, full, weight, 0.5, ("too short",), None)


def plan(stamp: float, size: int = 2) -> Plan:
    positions = np.zeros((STEPS + 1, size))
    positions[:, 0] = np.linspace(0.0, 2.0, STEPS + 1)
    level = np.full((STEPS, 1), 1.5)
    return Plan(
        stamp=stamp, dt=0.5, states=np.zeros((STEPS + 1, 5)), inputs=np.zeros((STEPS, 2)),
        positions=positions, reference=positions[1:], auxiliaries=np.zeros((STEPS, 1, 0)),
        level=level, target=level, content=np.full((STEPS, 1), 0.675), ids=(NASTY,),
        status=Status.LIMIT, rung=Rung.SHIFTED, reason="the solver <stopped>", iterations=17,
        violation=np.nan, forecast=forecast(size), tracked=(NASTY,),
        breach=Breach(BreachKind.REGION, NASTY, 3, 0.25),
    )  # fmt: skip


def agent(name: str, kind: str, begin: tuple[float, ...], move: tuple[float, ...]) -> AgentLog:
    size, robot = len(begin), kind == "robot"
    positions = np.array(begin) + TIMES[:, None] * np.array(move)
    count = len(STAMPS) if robot else 0
    none = np.zeros(count)
    return AgentLog(
        name=name, kind=kind, radius=0.3, positions=positions,
        headings=np.sin(TIMES) + 3.0, speeds=np.abs(np.cos(TIMES)), yaw_rates=0.0 * TIMES,
        paths=((0.0, Path(positions[[0, -1]])),) if robot else (), speed=0.5, period=0.5,
        reached=np.nan, skipped=0, footprint=None,
        commands=CommandLog(STAMPS[:count], STAMPS[:count], np.zeros((count, size)), none, none),
        plans=tuple(plan(stamp, size) for stamp in STAMPS) if robot else (),
    )  # fmt: skip


def episode(size: int = 2) -> Episode:
    """Two robots and a walker with a name of his own, who is away for a while."""
    walker = agent(NASTY, "replay", (-1.0, 2.0, 0.5)[:size], (0.3, 0.0, 0.1)[:size])
    walker.positions[80:100] = np.nan
    agents = (
        agent("first", "robot", (0.0, 0.0, 0.0)[:size], (0.5, 0.0, 0.1)[:size]),
        agent("second", "robot", (3.0, 1.0, 0.0)[:size], (-0.5, 0.1, 0.0)[:size]),
        walker,
    )
    walls = (Polygon(((5, -1), (6, -1), (6, 1), (5, 1)), "wall"),) if size == 2 else ()
    return Episode(TIMES, agents, "goals", 0.2, 3, polygons=walls)


def unpacked(text: str) -> dict:
    return json.loads(zlib.decompress(base64.b64decode(text)))


def numbers(steps: list, unit: float = LENGTH) -> np.ndarray:
    """What data/player.js makes of a series."""
    known = np.array([step is not None for step in steps])
    values = np.full(len(steps), np.nan)
    values[known] = np.cumsum([step for step in steps if step is not None]) * unit
    return values
