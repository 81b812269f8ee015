"""Pictures and films of episodes: what they show, and that they repeat."""

import io
from dataclasses import replace
from itertools import pairwise
from pathlib import Path as Folder

import numpy as np
import pytest
from matplotlib.text import Text
from PIL import Image
from scipy.stats import chi2

from wideberth.experiments.drawing.animation import animate
from wideberth.experiments.drawing.episodes import draw_run, draw_views
from wideberth.experiments.drawing.plotting import legend_below, paper_style, save, subplots
from wideberth.framework.values.errors import WideberthError
from wideberth.framework.values.forecast import Forecast
from wideberth.framework.values.path import Path
from wideberth.framework.values.plan import Plan, Rung, Status
from wideberth.metrics.episode import clearance
from wideberth.simulation.drawing.artists import closest, nose, outlines, plan_at
from wideberth.simulation.log.episode_log import AgentLog, CommandLog, Episode

TAIL = 0.05
TIMES = np.arange(0.0, 16.01, 0.1)
STEPS = 6
NO_COMMANDS = CommandLog(np.zeros(0), np.zeros(0), np.zeros((0, 2)), np.zeros(0), np.zeros(0))


def plan(stamp, positions, forecast=None, content=0.78, rung=Rung.OPTIMAL):
    """A plan along the given positions (N + 1, 2) with the reference on the x axis."""
    steps = len(positions) - 1
    count = 0 if forecast is None else len(forecast.mean)
    return Plan(
        stamp=stamp, dt=0.5, states=np.zeros((steps + 1, 5)), inputs=np.zeros((steps, 2)),
        positions=positions, reference=positions[1:] * np.array([1.0, 0.0]),
        auxiliaries=np.zeros((steps, count, 0)), level=np.ones((steps, count)),
        target=np.ones((steps, count)),
        content=np.full((steps, count), content), ids=("other",) * count,
        status=Status.SOLVED, rung=rung, forecast=forecast,
    )  # fmt: skip


def forecast(size=2):
    """One obstacle whose covariance grows and is not aligned with the axes."""
    mean = np.zeros((1, STEPS, size))
    mean[0, :, 0] = -0.25 * np.arange(1, STEPS + 1)
    root = np.eye(size) + 0.5 * np.tri(size, k=-1)
    growth = 0.1 * np.arange(1, STEPS + 1)
    return Forecast.single(mean, growth[None, :, None, None] * (root @ root.T), 0.5)


def robot(name, begin, move, plans=True, expects=True):
    """A robot that drives straight on at ``move`` m/s; plans once a second."""
    begin, move = np.array(begin), np.array(move)
    positions = begin + TIMES[:, None] * move
    ahead = 0.5 * np.arange(STEPS + 1)[:, None] * move
    made = [
        plan(t, begin + t * move + ahead, forecast() if expects else None)
        for t in np.arange(0.25, 15.0)
    ]
    speed = float(np.linalg.norm(move))
    return AgentLog(
        name=name, kind="robot", radius=0.75, positions=positions,
        headings=np.full(len(TIMES), np.arctan2(move[1], move[0])),
        speeds=np.full(len(TIMES), speed), yaw_rates=np.zeros(len(TIMES)),
        paths=((0.0, Path(np.stack([positions[0], positions[-1]]))),), speed=speed, period=1.0,
        reached=np.nan, skipped=0, commands=NO_COMMANDS, plans=tuple(made) if plans else (),
    )  # fmt: skip


def walker(name="walker"):
    """A recorded person who is absent at first, in between, and never turns."""
    unknown = np.full(len(TIMES), np.nan)
    positions = np.stack([0.3 * TIMES - 2.0, 2.0 + 0.0 * TIMES], axis=1)
    positions[:20] = positions[80:100] = np.nan
    return replace(
        robot(name, (0.0, 0.0), (1.0, 0.0), plans=False), kind="replay", radius=0.25,
        positions=positions, headings=unknown, speeds=unknown, yaw_rates=unknown, paths=(),
    )  # fmt: skip


def episode(*agents):
    """Two robots that pass each other with 1.7 m between the paths, and the agents given."""
    left = robot("left", (-4.0, -0.85), (0.5, 0.0))
    right = robot("right", (4.0, 0.85), (-0.5, 0.0))
    return Episode(TIMES, (left, right, *agents), "goals", 0.25, 0)


def labels(figure):
    return [text.get_text() for text in figure.legends[0].get_texts()]


def line(panel, label):
    (found,) = [line for line in panel.lines if line.get_label() == label]
    return np.stack(found.get_data(), axis=1)


def frames(data):
    with Image.open(io.BytesIO(data)) as film:
        shown = []
        for i in range(film.n_frames):
            film.seek(i)
            shown.append((film.info["duration"], np.asarray(film.convert("RGB"))))
    return shown


def test_outlines_lie_on_the_content_contour():
    expected = forecast()
    found = outlines(expected, TAIL)
    assert found.shape == (STEPS, 96, 2)
    for mean, covariance, outline in zip(
        expected.mean[0, 0], expected.covariance[0, 0], found, strict=True
    ):
        offset = outline - mean
        square = np.einsum("ki,ij,kj->k", offset, np.linalg.inv(covariance), offset)
        np.testing.assert_allclose(square, chi2.isf(TAIL, 2), rtol=1e-12)


def test_outlines_in_space_are_the_shadow_of_the_ellipsoid():
    expected = forecast(3)
    draws = np.random.default_rng(0).standard_normal((4000, 3))
    draws *= np.sqrt(chi2.isf(TAIL, 3)) / np.linalg.norm(draws, axis=1, keepdims=True)
    outline = outlines(expected, TAIL)[-1] - expected.mean[0, 0, -1, :2]
    surface = draws @ np.linalg.cholesky(expected.covariance[0, 0, -1]).T
    for angle in np.linspace(0.0, np.pi, 7):
        normal = np.array([np.cos(angle), np.sin(angle)])
        support = (surface[:, :2] @ normal).max()
        assert (outline @ normal).max() == pytest.approx(support, rel=5e-3)


def test_outlines_of_certain_light_and_missing_forecasts():
    mean = np.arange(12.0).reshape(1, 2, 3, 2)
    sure = Forecast(mean, np.zeros((1, 2, 3, 2, 2)), np.array([[1.0, 0.0]]), 0.5, (None,))
    found = outlines(sure, TAIL)  # the mode of weight 0 is left out
    np.testing.assert_array_equal(found, np.broadcast_to(mean[0, 0, :, None], (3, 96, 2)))
    assert outlines(None, TAIL).shape == (0, 96, 2)
    np.testing.assert_array_equal(
        outlines(forecast(), TAIL, every=3), outlines(forecast(), TAIL)[[2, 5]]
    )


def test_plan_and_heading_at_a_time():
    log = episode().agent("left")
    stamps = [plan_at(log, t).stamp for t in (0.0, 0.25, 1.24, 1.25, 99.0)]
    assert stamps == [0.25, 0.25, 0.25, 1.25, 14.25]
    assert plan_at(replace(log, plans=()), 1.0) is None
    np.testing.assert_allclose(nose(episode(), log, 4.0), [[-2.0, -0.85], [-1.25, -0.85]])


def test_closest_approach_of_two_straight_ways():
    left, right = episode().robots
    found = closest(episode())
    assert (found.pair[0].name, found.pair[1].name) == ("left", "right")
    assert found.time == pytest.approx(8.0)
    assert found.clearance == pytest.approx(1.7 - 1.5)
    assert found.clearance == clearance(left.positions, right.positions, 1.5)
    between = Episode(TIMES + 0.03, (left, right), "goals", 0.25, 0)
    assert closest(between).time == pytest.approx(8.03)
    assert closest(Episode(TIMES, (left,), "goals", 0.25, 0)) is None


def test_views_show_plan_reference_and_forecast():
    shown = episode()
    figure = draw_views(shown, distance=5.0, tail=TAIL)
    assert len(figure.axes) == 2
    apart = np.linalg.norm(shown.agents[0].positions - shown.agents[1].positions, axis=1)
    moment = TIMES[np.flatnonzero(apart <= 5.0)[0]]
    for panel, log in zip(figure.axes, shown.robots, strict=True):
        seen = plan_at(log, moment)
        assert seen.stamp <= moment < seen.stamp + 1.0
        np.testing.assert_array_equal(line(panel, "planned positions"), seen.positions[1:])
        np.testing.assert_array_equal(line(panel, "reference points"), seen.reference)
        np.testing.assert_array_equal(line(panel, "reference path"), log.paths[0][1].points)
        (regions,) = [c for c in panel.collections if str(c.get_label()).startswith("asked")]
        np.testing.assert_array_equal(
            [path.vertices[:-1] for path in regions.get_paths()],
            outlines(forecast(), TAIL, every=3),
        )
        bodies = [c for c in panel.collections if c is not regions]
        assert [body.get_hatch() for body in bodies].count(None) == 1  # told apart without colour
        own = next(body for body in bodies if body.get_hatch() is None)
        rim = own.get_paths()[0].vertices
        np.testing.assert_allclose(
            np.linalg.norm(rim - seen.positions[0], axis=1), log.radius, rtol=1e-9
        )
        assert panel.get_aspect() == 1.0
        assert panel.get_xlabel() == "x (m)"
        title = panel.get_title()
        head, held = title.splitlines()
        assert head == f"{log.name} robot's view, t = {seen.stamp:.2f} s"
        assert held == "plan holds 78 % content, 95 % asked"
    spans = [(np.ptp(panel.get_xlim()), np.ptp(panel.get_ylim())) for panel in figure.axes]
    np.testing.assert_allclose(spans[0], spans[1])
    assert labels(figure) == [
        "reference path", "reference points", "planned positions",
        "asked content 95 %, not enlarged", "robot and its trail", "obstacle and its trail",
    ]  # fmt: skip


def test_views_where_they_never_come_so_near():
    figure = draw_views(episode(), distance=1.0, tail=TAIL)
    assert "t = 7.25 s" in figure.axes[0].get_title()  # the plan followed at 8 s, the closest


def test_views_of_other_plans():
    left, right = episode().robots
    lone = plan(0.25, left.positions[:7])
    weak = [replace(p, content=0.0 * p.content, rung=Rung.SHIFTED) for p in right.plans]
    agents = (replace(left, plans=(lone,)), replace(right, plans=tuple(weak)), walker())
    shown = Episode(TIMES, agents, "goals", 0.25, 0)
    figure = draw_views(shown, distance=5.0, tail=TAIL)
    first, second = (panel.get_title().splitlines()[1] for panel in figure.axes)
    assert first == "plan without obstacles"
    assert second == "shifted last plan holds less than 1 % content, 95 % asked"
    without = Episode(TIMES, (replace(left, plans=()), right), "goals", 0.25, 0)
    figure = draw_views(without, distance=5.0, tail=TAIL)
    assert figure.axes[0].get_title().endswith("no plan")
    assert "planned positions" in labels(figure)  # from the panel that has one


@pytest.mark.parametrize(
    ("settings", "message"),
    [
        ({"distance": 0.0, "tail": 0.1}, "distance"),
        ({"distance": 1.0, "tail": 1.0}, "tail"),
    ],
)
def test_views_refuse(settings, message):
    with pytest.raises(WideberthError, match=message):
        draw_views(episode(), **settings)


def test_views_are_of_two_robots():
    alone = Episode(TIMES, (episode().agents[0], walker()), "goals", 0.25, 0)
    with pytest.raises(WideberthError, match=r"two robots.*1: \['left'\]"):
        draw_views(alone, distance=5.0, tail=TAIL)


def test_run_shows_ways_marks_and_the_closest_approach():
    upper = robot("upper", (1.0, 4.0), (0.0, -0.2), plans=False)
    figure = draw_run(episode(upper, walker("a"), walker("b")))
    panel = figure.axes[0]
    named = labels(figure)
    assert named == [
        "reference path", "start", "goal", "left, marks every 5 s", "right, marks every 5 s",
        "upper, marks every 5 s", "replayed", named[-1],
    ]  # fmt: skip
    found = closest(episode(upper, walker("a"), walker("b")))
    assert named[-1] == (
        f"least clearance between agents\n\u2212{-found.clearance:.2f} m at {found.time:.1f} s"
    )
    times = [text.get_text() for text in panel.texts]
    assert times == ["5 s", "10 s", "15 s"] * 3
    assert panel.get_aspect() == 1.0
    ends = line(panel, named[-1])
    assert np.linalg.norm(ends[1] - ends[0]) == pytest.approx(abs(found.clearance))


def test_run_of_one_robot_that_stands():
    left = episode().agents[0]
    still = replace(left, positions=np.repeat(left.positions[:1], len(TIMES), axis=0))
    figure = draw_run(Episode(TIMES, (still,), "time limit", 0.25, 0))
    assert not figure.axes[0].texts  # no numbers one upon the other
    assert "least" not in " ".join(labels(figure))


def test_figures_are_written_the_same(tmp_path):
    written = []
    for name in ("one", "two"):
        with paper_style():
            files = save(draw_views(episode(walker()), distance=5.0, tail=TAIL), tmp_path, name)
            files += save(draw_run(episode(walker())), tmp_path, f"run_{name}")
        written.append([file.read_bytes() for file in files])
    assert written[0] == written[1]


def test_film_repeats_and_keeps_its_speed():
    film = animate(episode(), tail=TAIL)
    assert film == animate(episode(), tail=TAIL)
    assert len(film) < 1_500_000
    shown = frames(film)
    durations = [duration for duration, _ in shown]
    assert durations[-1] == 1500
    assert sum(durations[:-1]) == pytest.approx(1000 * 16.0 / 4.0)
    assert len(shown) == 41
    pixels = [image for _, image in shown]
    assert all((a != b).any() for a, b in pairwise(pixels))
    assert (pixels[0][0, 0] == 255).all()  # paper stays white


def test_film_of_many_and_of_one():
    upper = robot("upper", (1.0, 4.0), (0.0, -0.2), expects=False)
    several = episode(upper, walker("a"), walker("b"))
    assert len(frames(animate(several, tail=TAIL, rate=5.0, seconds_per_second=8.0))) == 11
    alone = Episode(TIMES, (robot("left", (0.0, 0.0), (0.5, 0.0), plans=False),), "", 0.25, 0)
    assert len(frames(animate(alone, tail=TAIL, rate=5.0, seconds_per_second=8.0))) == 11


@pytest.mark.parametrize("settings", [{"tail": 0.0}, {"rate": 0.0}, {"seconds_per_second": -1.0}])
def test_film_refuses(settings):
    with pytest.raises(WideberthError, match=next(iter(settings))):
        animate(episode(), **{"tail": TAIL, **settings})


@pytest.mark.parametrize("name", ["price$$low", "5$ to 10$", "$x_1$", "a $\\nothing$ b", "1 $"])
def test_dollar_signs_of_names_are_printed(tmp_path: Folder, name: str) -> None:
    """At every place at which figures print names; a formula of a study stays one."""
    figure, panel = subplots()
    panel.plot([1.0, 2.0], [1.0, 100.0], label=name)
    panel.set(title=name, ylabel=name, xlabel="$\\rho$ (m)", yscale="log")
    panel.set_xticks([1.0, 2.0], [name, "usual"])
    panel.annotate(name, (1.5, 10.0))
    legend_below(figure, [panel])
    save(figure, tmp_path, "names")
    printed = [text for text in figure.findobj(Text) if text.get_text() == name]
    assert len(printed) >= 5 and not any(text.get_parse_math() for text in printed)
    assert panel.xaxis.label.get_parse_math()
    powers = [text for text in panel.get_yticklabels() if "mathdefault" in text.get_text()]
    assert powers and all(text.get_parse_math() for text in powers)


def test_ways_of_many_others_are_pale():
    for count, pale in ((2, False), (12, True)):
        figure = draw_run(episode(*(walker(str(i)) for i in range(count))))
        ways = [line for line in figure.axes[0].lines if line.get_color() == "0.55"]
        assert any(line.get_alpha() == 0.5 for line in ways) == pale
