"""Figures of comparisons: what is drawn is named, and few episodes have no interval."""

from typing import Any

import numpy as np
import pytest
from matplotlib import pyplot

from wideberth.experiments.drawing.plotting import few, paper_style, subplots
from wideberth.experiments.drawing.shaded_tables import shaded
from wideberth.experiments.drawing.trade_off_markers import (
    LEAST_CLEARANCE,
    LEAST_TIME,
    front_legend,
    front_looks,
    mark,
    nest,
)
from wideberth.experiments.engine.base import Row
from wideberth.experiments.studies import comparison_figures as figures
from wideberth.experiments.studies.planner_parts import draw_tables

NAMES = ["ours", "orca", "lost"]


def played(seeds: int, lost: bool = True) -> list[Row]:
    """Three controllers at some seeds; the last one, or all, never arrive."""
    rows: list[Row] = []
    for i, name in enumerate(NAMES):
        for seed in range(seeds):
            arrived = i < 2 and not lost
            rows.append(
                {
                    "scenario": "field", "robot": "disc", "settings": "plain", "controller": name,
                    "seed": seed, "success": arrived, "clearance": 0.3 + 0.001 * (i + seed),
                    "success_time": 27.25 + 0.01 * i + 0.001 * seed if arrived else np.nan,
                    "outcome": "success" if arrived else "timeout",
                }
            )  # fmt: skip
    return rows


@pytest.fixture(autouse=True)
def closed() -> Any:
    with paper_style():
        yield
    pyplot.close("all")


def legend(figure: Any) -> tuple[list[str], str]:
    """Entries and title of the legend below a figure."""
    (found,) = figure.legends
    return [text.get_text() for text in found.get_texts()], found.get_title().get_text()


@pytest.mark.parametrize("seeds", [4, 12])
def test_whiskers_of_outcomes_are_explained_or_left_out(seeds: int) -> None:
    figure = figures._outcomes(played(seeds, lost=False))
    whiskers = [line for line in figure.axes[0].lines if line.get_marker() == "|"]
    _, words = legend(figure)
    if seeds < 10:
        assert not whiskers and words == "4 episodes each: too few for intervals"
    else:
        assert len(whiskers) == 2 * len(NAMES)
        assert words == "whiskers: intervals of 95 %, above of success, below of collision"


@pytest.mark.parametrize("seeds", [4, 12])
def test_front_names_what_it_shows_on_axes_that_can_be_read(seeds: int) -> None:
    """An entry for each marker and no more; no axis from 27.23 to 27.27 s."""
    figure = figures.draw_front(played(seeds, lost=False), NAMES)
    panel = figure.axes[0]
    entries, words = legend(figure)
    assert entries == ["ours", "orca"]  # nobody of "lost" arrived: it has no marker
    assert np.ptp(panel.get_xlim()) > 0.999 * LEAST_TIME
    assert np.ptp(panel.get_ylim()) > 0.999 * LEAST_CLEARANCE
    markers = [line for line in panel.lines if line.get_marker() in ("o", "s")]
    assert len(markers) == 2
    bars = [line for line in panel.lines if line.get_linestyle() == "-" and len(markers)]
    assert len(bars) == (1 if seeds < 10 else 1 + 2 * 2)  # the line at 0 m, and two bars each
    assert ("too few" in words) == (seeds < 10) and ("quartiles" in words) == (seeds >= 10)


@pytest.mark.parametrize("seeds", [4, 12])
def test_pairs_have_an_interval_of_enough_seeds_alone(seeds: int) -> None:
    figure = figures._pairs(played(seeds, lost=False), NAMES, "ours")
    entries, words = legend(figure)
    intervals = [line for line in figure.axes[0].lines if line.get_linewidth() == 1.2]
    if seeds < 10:
        assert not [line for line in intervals if line.get_linestyle() == "-"]
        assert entries == ["one seed", "mean"] and "fewer than 10" in words
    else:
        assert len([line for line in intervals if line.get_linestyle() == "-"]) == 1
        assert entries[-1] == "its interval of 95 %"
    assert np.ptp(figure.axes[0].get_xlim()) > 0.999 * LEAST_TIME
    assert figure.axes[0].texts[0].get_text().startswith(f"both arrived: {seeds}; ")


def test_no_pair_is_said_instead_of_an_empty_box() -> None:
    figure = figures._pairs(played(12), NAMES, "ours")
    entries, words = legend(figure)
    assert not entries
    assert words == "there is no seed at which both arrived: no times to compare"
    assert not figure.axes[0].lines and not len(figure.axes[0].get_xticks())


def test_few_counts_episodes() -> None:
    assert few([]) == few([10, 40]) == ""
    assert few([1, 1]) == "1 episode each: too few for intervals"
    assert few([9, 12]) == "9 to 12 episodes each: too few for intervals"


def test_a_legend_of_long_names_has_fewer_columns_and_is_seen_whole() -> None:
    names = ["ours", "ours_watching", "dynamic_window", "pure_pursuit", "constant_velocity"]
    short = ["a", "b", "c", "d", "e"]
    for labels, columns in ((short, 4), (names * 2, 3)):
        looks = {f"{name}{i}": ("o", "k") for i, name in enumerate(labels)}
        figure, _ = subplots(figsize=(4.3, 2.9), layout="constrained")
        front_legend(figure, looks, [10] * len(labels))
        (legend,) = figure.legends
        assert legend._ncols == columns  # type: ignore[attr-defined]
        assert legend.get_window_extent().width <= figure.bbox.width


def test_markers_at_one_place_are_all_seen() -> None:
    """The ones below are larger, so that their rims stand around the ones above."""
    _, panel = subplots()
    rows = [
        {"success": True, "success_time": 10.0, "clearance": 0.2},
        {"success": True, "success_time": 12.0, "clearance": 0.4},
    ]
    for name, look in front_looks(["a", "b", "c"]).items():
        mark(panel, rows[1:] if name == "c" else rows[:1], "success_time", look)
    nest(panel)
    sizes = [line.get_markersize() for line in panel.lines if line.get_marker() != "None"]
    assert sizes == [9.0, 5.0, 5.0]


def test_whiskers_stand_beside_the_bars() -> None:
    rows = [{"outcome": "success" if i % 2 else "timeout"} for i in range(12)]
    _, panel = subplots()
    figures._bar(panel, 0, rows)
    half = 0.5 * panel.patches[0].get_height()
    heights = [float(line.get_ydata()[0]) for line in panel.lines]
    assert len(heights) == 2 and all(abs(height) > half for height in heights)


def test_numbers_that_are_printed_alike_have_one_colour() -> None:
    _, panel = subplots()
    shaded(panel, np.array([[0.896, 0.9], [1.0, np.nan]]), ".2f", better_high=True)
    shades = panel.images[0].get_array()
    assert shades[0, 0] == shades[0, 1] == 0.0 and shades[1, 0] == 1.0
    shaded(panel, np.array([[1.0, 1.001]]), ".2f", better_high=True)
    assert (panel.images[1].get_array() == 0.0).all()  # nothing is better than another


def test_planner_parts_name_axes_and_episodes() -> None:
    line = {"scenario": "s", "region": "r", "success": 1.0, "time_mean_s": 9.0}
    line |= {"clearance_median_m": 0.4, "intrusion_share": 0.1}
    lines = [{**line, "predictor": name, "episodes": n} for name, n in (("p", 4), ("q", 3))]
    figure = draw_tables(lines, ["predictor", "region"])
    assert [panel.get_ylabel() for panel in figure.axes] == ["predictor"] * 4
    assert figure.axes[-1].get_xlabel() == "region"
    assert all("n = 3 to 4" in panel.get_title() for panel in figure.axes)
