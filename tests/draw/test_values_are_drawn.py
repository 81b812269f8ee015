"""Plans, forecasts, regions and paths are drawn, and the session stays as it was."""

import matplotlib
import numpy as np
import pytest
from matplotlib import pyplot
from matplotlib.collections import PolyCollection

from wideberth import (
    Detection,
    Forecast,
    GaussianObstacle,
    Observation,
    Path,
    Polygon,
    Tracks,
    build,
    draw,
    recommended,
)
from wideberth.draw.plans import kept_out
from wideberth.draw.style import chosen_steps, paper_style, shades
from wideberth.framework.values.plan import Plan
from wideberth.tests.helpers.planning import past_a_walker


@pytest.fixture(scope="module")
def plan() -> Plan:
    """A plan past a walker who crosses the path."""
    plan = past_a_walker().plan
    assert plan is not None
    return plan


def polygons_of(panel) -> dict[str, PolyCollection]:  # type: ignore[no-untyped-def]
    return {one.get_gid() or one.get_label(): one for one in panel.collections}


def test_a_plan_shows_what_it_keeps_out_of(plan: Plan) -> None:
    before, backend = dict(matplotlib.rcParams), matplotlib.get_backend()
    panel = draw.plan(plan)
    assert (dict(matplotlib.rcParams), matplotlib.get_backend()) == (before, backend)
    assert (panel.get_xlabel(), panel.get_ylabel()) == ("x (m)", "y (m)")
    assert panel.get_aspect() == 1.0 and "plan at t = 0 s, holds" in panel.get_title("left")
    steps = chosen_steps(len(plan.inputs))
    assert steps == [0, 2, 4, 6, 8, 10, 12, 14]
    (rims,) = kept_out(plan, plan.situation, steps).values()
    for step, rim, shade in zip(steps, rims, shades(8), strict=True):
        drawn = polygons_of(panel)[f"kept out of at step {step + 1}"]
        assert np.allclose(drawn.get_paths()[0].vertices[:-1], rim)
        assert np.allclose(drawn.get_edgecolor()[0][:3], shade)
        (marker,) = [line for line in panel.lines if line.get_marker() == "s"
                     and np.allclose(line.get_xydata(), plan.positions[step + 1])]  # fmt: skip
        assert marker.get_color() == shade
        # The plan is outside of what is drawn, and the boundary is at the level's distance.
        away = np.linalg.norm(rim - plan.positions[step + 1], axis=1).min()
        assert away >= 0.0 and rim.shape == (64, 2)
    body = polygons_of(panel)["robot"].get_paths()[0].vertices
    assert np.allclose(np.linalg.norm(body - plan.positions[0], axis=1), 0.75)
    labels = panel.get_legend_handles_labels()[1]
    assert len(labels) == len(set(labels)) == 5 and panel.figure.legends
    low, high = panel.get_ylim()
    assert low < rims[..., 1].min() and high > rims[..., 1].max()


def test_axes_of_the_users_keep_their_figure(plan: Plan) -> None:
    figure, panels = pyplot.subplots(1, 2)
    assert plan.forecast is not None
    assert draw.plan(plan, panels[0]) is panels[0] and panels[0].lines
    assert draw.forecast(plan.forecast, panels[1]) is panels[1] and panels[1].lines
    assert not figure.legends and not panels[0].get_legend()
    (mean,) = [line for line in panels[1].lines if len(line.get_xdata()) == 15]
    assert np.allclose(mean.get_xydata(), plan.forecast.mean[0, 0])
    ellipses = panels[1].collections[0].get_paths()
    assert len(ellipses) == 8
    away = ellipses[-1].vertices - plan.forecast.mean[0, 0, -1]
    inverse = np.linalg.inv(plan.forecast.covariance[0, 0, -1])
    chi2 = np.einsum("ki,ij,kj->k", away, inverse, away)
    assert np.allclose(chi2, 5.9915, rtol=1e-3)  # chi^2 with two degrees of freedom, 95 %


def test_modes_are_paler_the_less_they_weigh() -> None:
    mean = np.zeros((2, 2, 3, 3))
    mean[..., 0] = np.arange(3)
    cov = np.broadcast_to(0.04 * np.eye(3), (2, 2, 3, 3, 3))
    forecast = Forecast(mean, cov, np.array([[0.7, 0.3], [1.0, 0.0]]), 0.5, (None, "too short"))
    panel = draw.forecast(forecast)
    assert panel.name == "3d" and panel.get_zlabel() == "z (m)"
    drawn = {line.get_label(): line.get_alpha() for line in panel.lines if len(line._verts3d[0])}
    assert sorted(drawn) == ["obstacle 0, 30 %", "obstacle 0, 70 %", "obstacle 1"]
    assert drawn["obstacle 0, 30 %"] < drawn["obstacle 0, 70 %"] < drawn["obstacle 1"]
    assert repr(forecast) == ("Forecast(2 obstacles in 3 dimensions, 2 modes each, 3 steps of "
                              "0.5 s, 1 by another method)")  # fmt: skip


def test_the_first_figure_chooses_the_interactive_mode_for_good() -> None:
    """A notebook's backend is loaded by the first figure, and shows only what is interactive."""
    square = Polygon(((0, 0), (2, 0), (2, 1), (0, 1)))
    with matplotlib.rc_context():
        matplotlib.interactive(False)
        with paper_style():
            matplotlib.interactive(True)  # as such a backend does when it is loaded
        assert matplotlib.is_interactive() and matplotlib.rcParams["font.size"] != 8
        draw.polygon(square)
        assert matplotlib.is_interactive()
        with pytest.raises(ZeroDivisionError), paper_style():
            matplotlib.interactive(False)
            raise ZeroDivisionError
        assert not matplotlib.is_interactive()


@pytest.mark.parametrize("name", ["mahalanobis_ellipse", "luetkepohl_rectangle", "half_plane"])
def test_a_region_is_drawn_by_its_boundary(name: str) -> None:
    region = build("regions", name)
    obstacle = GaussianObstacle(np.array([1.0, 2.0]), np.diag([0.25, 0.04]))
    level = region.level(0.05)
    panel = draw.region(region, obstacle=obstacle, margin=0.5, level=level)
    (rim,) = [one.get_paths()[0].vertices[:-1] for one in panel.collections
              if str(one.get_label()).startswith("kept out of")]  # fmt: skip
    numbers = region.parameters(obstacle, np.array(0.5))
    assert not region.contains(1.001 * (rim - obstacle.mean) + obstacle.mean, numbers, level).any()
    assert region.contains(0.99 * (rim - obstacle.mean) + obstacle.mean, numbers, level).all()


def test_a_region_is_drawn_in_space() -> None:
    region = build("regions", "mahalanobis_ellipse")
    sphere = GaussianObstacle(np.zeros(3), 0.04 * np.eye(3))
    assert draw.region(region, obstacle=sphere, margin=0.5).name == "3d"


def test_a_polygon_is_drawn_by_its_outline_and_its_parts() -> None:
    corner = Polygon(((0, 0), (2, 0), (2, 1), (1, 1), (1, 3), (0, 3)), "corner")
    panel = draw.polygon(corner)
    drawn = polygons_of(panel)
    assert list(drawn) == ["corner", "convex parts"]
    (outline,) = drawn["corner"].get_paths()
    assert np.array_equal(outline.vertices[:-1], corner.points)
    cuts = [path.vertices[:-1] for path in drawn["convex parts"].get_paths()]
    assert len(cuts) == 2 and all(map(np.array_equal, cuts, corner.parts))
    assert panel.get_xlim()[0] < 0.0 and panel.get_ylim()[1] > 3.0
    ax = pyplot.figure().add_subplot()
    square = Polygon(((0, 0), (2, 0), (2, 1), (0, 1)))
    assert draw.polygon(square, ax) is ax and list(polygons_of(ax)) == ["static"]


def test_a_path_is_drawn_with_its_ends() -> None:
    path = Path([(0, 0), (3, 0), (4, 2)])
    panel = draw.path(path)
    drawn = {line.get_label(): line.get_xydata() for line in panel.lines}
    assert np.array_equal(drawn["path"], path.points)
    assert np.array_equal(drawn["start"], [[0, 0]]) and np.array_equal(drawn["goal"], [[4, 2]])


def test_values_know_nothing_of_pictures(plan: Plan) -> None:
    """A value has no method that draws, and no file of the framework imports what draws."""
    assert plan.forecast is not None and plan.situation is not None
    for value in (plan, plan.forecast, plan.situation.path, plan.situation.region):
        assert not hasattr(value, "plot") and not hasattr(value, "_repr_png_")


def test_reprs_are_short(plan: Plan) -> None:
    planner = recommended(quiet=True)
    assert len(repr(planner).splitlines()) == 9 and max(map(len, repr(planner).split("\n"))) < 130
    assert "AdaptiveConformal(" in repr(planner) and "15 steps of 0.5 s" in repr(planner)
    assert "20 steps of 0.25 s" in repr(recommended(speed=1.0, quiet=True))
    assert planner.last_plan is None and "none yet" in repr(planner)
    detections = tuple(Detection(f"w{i}", (i, 0.0), np.eye(2), 0.3) for i in range(30))
    lines = repr(Observation(1.5, (0, 0, 0, 0.5, 0), detections)).splitlines()
    assert lines[0] == "Observation(stamp 1.5 s, state (0, 0, 0, 0.5, 0), 30 detections)"
    assert lines[1] == "  'w0' at [0.0, 0.0], radius 0.3 m" and lines[9:] == ["  and 22 more"]
    noise = np.broadcast_to(np.eye(2), (2, 2, 2))
    places = np.zeros((2, 40, 2))
    places[1, :20] = np.nan
    tracks = Tracks(places, 0.5, ("a", "b"), np.ones(2), noise)
    assert repr(tracks) == (
        "Tracks(2 obstacles in 2 dimensions ('a', 'b'), 40 samples of 0.5 s up to 0 s, "
        "75 % observed)"
    )
    assert repr(plan).startswith("Plan(solved by 'optimal', 15 steps of 0.5 s from 0 s, 1 obst")
    assert len(repr(plan)) < 300 and len(repr(plan).splitlines()) <= 2
    assert repr(Path([(0, 0), (3, 0)])) == "Path([(0.0, 0.0), (3.0, 0.0)])"
    long = Path(np.column_stack([np.arange(100.0), np.zeros(100)]))
    assert repr(long) == "Path(100 points, 99 m, from (0.0, 0.0) to (99.0, 0.0))"
