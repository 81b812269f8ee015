"""What pictures and films show of plans: the sets kept out of at the plan's own level."""

from dataclasses import replace
from itertools import combinations

import numpy as np
import pytest
from matplotlib.collections import PolyCollection

from wideberth.experiments.drawing import animation
from wideberth.experiments.drawing.episodes import draw_run, draw_views
from wideberth.experiments.drawing.kept_out import kept_out_of
from wideberth.experiments.drawing.plotting import paper_style
from wideberth.framework.mpc.planner.planner import Planner, planner_behind
from wideberth.framework.plugins.config import build
from wideberth.simulation.log.episode_log import Episode
from wideberth.tests.experiments.test_drawing import (
    STEPS,
    TAIL,
    TIMES,
    episode,
    forecast,
    robot,
    walker,
)
from wideberth.tests.helpers.straight import Straight

ROOM = 0.75 + 0.25 + 0.1  # m: radii of robot and obstacle, and the planner's margin
LEVEL = 0.8


@pytest.fixture(scope="module")
def planner() -> Planner:
    config = {
        "type": "mpc", "robot": "unicycle", "region": "mahalanobis_ellipse",
        "predictor": "static", "level": "fixed", "solver": "riccati", "margin": 0.1,
    }  # fmt: skip
    found = build("controllers", config)
    assert isinstance(found, Planner)
    return found


@pytest.fixture(scope="module")
def met() -> Episode:
    """Two robots whose plans hold the level 0.8 towards one obstacle."""
    made = episode(walker("other"))
    agents = []
    for log in made.agents:
        plans = [
            replace(plan, tracked=("other",), level=np.full((STEPS, 1), LEVEL))
            for plan in log.plans
        ]
        agents.append(replace(log, plans=tuple(plans)))
    return replace(made, agents=tuple(agents))


def gauge(points: np.ndarray, step: int) -> np.ndarray:
    """Gauge of the enlarged ellipse at the level that the plan holds; 1 on its boundary."""
    known = forecast()
    values, vectors = np.linalg.eigh(known.covariance[0, 0, step])
    axes = LEVEL * np.sqrt(values) + ROOM
    return np.hypot.reduce(((points - known.mean[0, 0, step]) @ vectors) / axes, axis=-1)


def test_views_draw_what_the_plan_holds_enlarged(met: Episode, planner: Planner) -> None:
    """Solid at the plan's level and margin; the asked content pale; a shade for each step."""
    figure = draw_views(met, distance=5.0, tail=TAIL, planner=planner)
    for panel in figure.axes:
        drawn = {c.get_gid(): c for c in panel.collections if c.get_gid()}
        assert list(drawn) == [f"kept out of at step {step + 1}" for step in (2, 5)]
        shades = []
        for step, regions in zip((2, 5), drawn.values(), strict=True):
            (path,) = regions.get_paths()
            np.testing.assert_allclose(gauge(path.vertices, step), 1.0, atol=2e-3)
            assert regions.get_edgecolor()[0, 3] == 1.0  # solid
            shades.append(regions.get_edgecolor()[0, :3])
        grey = [shade @ (0.299, 0.587, 0.114) for shade in shades]
        assert grey[0] - grey[1] > 0.3  # told apart without colour
        marks = [line for line in panel.lines if line.get_marker() == "s"][:2]
        np.testing.assert_array_equal([line.get_color() for line in marks], shades)
        assert [text.get_text() for text in panel.texts] == ["1.5 s", "3 s"]
        (asked,) = [c for c in panel.collections if str(c.get_label()).startswith("asked")]
        assert asked.get_edgecolor()[0, 3] < 0.5 and asked.get_zorder() < drawn.popitem()[1].zorder
    names = [text.get_text() for text in figure.legends[0].get_texts()]
    assert "kept out of, in the shade of its step" in names


def test_film_draws_what_the_plan_holds_enlarged(met: Episode, planner: Planner) -> None:
    with paper_style():
        frames = animation._Frames(met, TAIL, planner, "4 times real time")
        frames.image(8.0)
    actor = frames.stage.actors[0]
    for step, path in zip((2, 5), actor.kept.get_paths(), strict=True):
        np.testing.assert_allclose(gauge(path.vertices, step), 1.0, atol=2e-3)
    assert actor.kept.get_edgecolor()[0, 3] == 1.0 > 0.5 > actor.asked.get_edgecolor()[0, 3]
    assert actor.shown is not None
    large = np.stack(actor.marks.get_data(), axis=1)
    np.testing.assert_array_equal(large, actor.shown.positions[[3, 6]])


@pytest.mark.parametrize("move", [(0.5, 0.0), (0.0, 0.5)])
def test_header_of_a_film_is_no_wider_than_its_axes(move: tuple[float, float]) -> None:
    far = robot("far", (-40.0 * move[0], -40.0 * move[1]), (10.0 * move[0], 10.0 * move[1]))
    with paper_style():
        made = Episode(TIMES, (far, walker()), "", 0.25, 0)
        frames = animation._Frames(made, TAIL, None, "4 times real time")
        frames.image(16.0)
        stage, renderer = frames.stage, frames.canvas.get_renderer()
        header = stage.text.get_window_extent(renderer)
        axes = stage.panel.get_window_extent(renderer)
    assert stage.text.get_text().startswith("t = 16.0 s, 4 times real time\nclearance ")
    assert header.x0 >= axes.x0 - 1.0 and header.x1 <= axes.x1 + 1.0
    assert header.y1 <= stage.figure.bbox.y1 and header.y0 >= axes.y1


def test_times_in_a_run_have_a_unit_and_do_not_collide() -> None:
    """Five robots side by side: labels without room are left out, not written over others."""
    crowd = [robot(f"r{i}", (-4.0, 0.3 * i), (0.5, 0.02 * i)) for i in range(5)]
    with paper_style():
        figure = draw_run(Episode(TIMES, tuple(crowd), "", 0.25, 0))
        figure.canvas.draw()
        texts = figure.axes[0].texts
        boxes = [text.get_window_extent() for text in texts]
        panel = figure.axes[0].get_window_extent()
    assert len(texts) >= 5 and all(text.get_text().endswith(" s") for text in texts)
    assert not any(one.overlaps(other) for one, other in combinations(boxes, 2))
    assert all(panel.x0 <= box.x0 and box.x1 <= panel.x1 for box in boxes)


def test_no_set_without_the_planner(met: Episode, planner: Planner) -> None:
    figure = draw_views(met, distance=5.0, tail=TAIL)
    kept = [c for c in figure.axes[0].collections if c.get_gid()]
    assert not kept and isinstance(figure.axes[0].collections[0], PolyCollection)
    assert planner_behind(planner) is planner and planner_behind(Straight()) is None
    log = replace(met.robots[0].plans[0], level=np.zeros((STEPS, 0)))
    assert kept_out_of(met, met.robots[0], log, planner, [0]) == {}
