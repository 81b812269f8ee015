"""The player of an episode: what it is given equals the episode, and its script runs."""

import json
import os
import re
import shutil
import subprocess
import sys
from dataclasses import replace
from html.parser import HTMLParser
from pathlib import Path as File

import numpy as np
import pytest

from wideberth.experiments.cli import app as cli
from wideberth.experiments.report.player import (
    LENGTH,
    PLAYER,
    TEMPLATES,
    TIME,
    Recorded,
    content,
    ellipses,
    find_episodes,
    packed,
    play,
    result_tail,
    series,
)
from wideberth.framework.values.errors import WideberthError
from wideberth.framework.values.footprint import Discs, Outline
from wideberth.simulation.drawing import artists
from wideberth.tests.helpers.player_samples import (
    NASTY,
    STAMPS,
    episode,
    forecast,
    numbers,
    unpacked,
)


@pytest.mark.parametrize("size", [2, 3])
def test_positions_and_plans_are_those_of_the_episode(size: int) -> None:
    made = episode(size)
    stored = unpacked(packed(made, 0.1))
    times = numbers(stored["frames"], TIME)
    assert (np.diff(times) > 0).all() and times[-1] == pytest.approx(made.duration)
    assert np.isin(np.rint(STAMPS / TIME), np.rint(times / TIME)).all()
    for log, found in zip(made.agents, stored["agents"], strict=True):
        places = np.stack([numbers(column) for column in found["positions"]], axis=1)
        np.testing.assert_allclose(places, made.at(log, times), atol=0.51 * LENGTH)
    for log, found in zip(made.robots, stored["agents"][:2], strict=True):
        assert [one["stamp"] for one in found["plans"]] == [round(s / TIME) for s in STAMPS]
        for one, kept in zip(log.plans, found["plans"], strict=True):
            for name in ("positions", "reference"):
                places = np.stack([numbers(column) for column in kept[name]], axis=1)
                np.testing.assert_allclose(places, getattr(one, name), atol=0.51 * LENGTH)
            assert (kept["status"], kept["rung"], kept["iterations"]) == (
                "iteration limit", "shifted last plan", 17,
            )  # fmt: skip
            assert kept["breach"] == str(one.breach) and kept["violation"] is None
            (entry,) = kept["forecast"]  # the mode of weight 0 is left out
            assert entry["name"] == NASTY and kept["fallbacks"] == [f"{NASTY}: too short"]
            assert len(entry["ellipses"]) == size - 1 and len(entry["mean"]) == size


def test_clearance_is_that_of_the_film() -> None:
    made = episode()
    stored = unpacked(packed(made, 0.1))
    index = np.searchsorted(made.times, numbers(stored["frames"], TIME) + 1e-9) - 1
    own = [numbers(found["clearance"]) for found in stored["agents"][:2]]
    now = artists.clearance_over_time(made)[index]
    np.testing.assert_allclose(np.fmin(*own), now, atol=0.51 * LENGTH)
    least = [numbers(found["least"])[-1] for found in stored["agents"][:2]]
    assert min(least) == pytest.approx(np.nanmin(artists.clearance_over_time(made)), abs=LENGTH)


def test_ellipses_and_what_the_plan_held() -> None:
    assert series(np.array([np.nan, np.inf])) == [None, None] and series(np.zeros(0)) == []
    (entry,) = content(episode(), 0.1)["agents"][0]["plans"][0]["forecast"]
    long, short, angle = (numbers(column) for column in entry["ellipses"][0])
    t = np.linspace(0.0, 2.0 * np.pi, 48, endpoint=False)
    turn = np.stack([[np.cos(angle), -np.sin(angle)], [np.sin(angle), np.cos(angle)]])
    own = np.stack([np.outer(long, np.cos(t)), np.outer(short, np.sin(t))], axis=1)
    rim = np.einsum("ijn,njt->nti", turn, own)
    mean = np.stack([numbers(column) for column in entry["mean"]], axis=1)
    known = forecast()
    away = rim + (mean - known.mean[0, 0])[:, None]
    square = np.einsum("nti,nij,ntj->nt", away, np.linalg.inv(known.covariance[0, 0]), away)
    np.testing.assert_allclose(square, -2.0 * np.log(0.1), rtol=0.01)  # both are rounded
    # For D = 2 the level of content p is sqrt(-2 ln(1 - p)).
    held = np.sqrt(np.log(1.0 - 0.675) / np.log(0.1))
    np.testing.assert_allclose(numbers(entry["held"]), held, atol=LENGTH)


def test_angles_do_not_jump_along_a_forecast() -> None:
    turn = np.linspace(0.0, 4.0, 60)
    root = np.array([[np.cos(turn), -np.sin(turn)], [np.sin(turn), np.cos(turn)]]).transpose(
        2, 0, 1
    )
    found = ellipses(root @ np.diag([4.0, 1.0]) @ root.transpose(0, 2, 1), 1.0)
    np.testing.assert_allclose(found[:, :2], [[2.0, 1.0]] * 60)
    np.testing.assert_allclose(found[:, 2] - found[0, 2], turn, atol=1e-9)


def test_many_forecasts_are_thinned(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("wideberth.experiments.report.player._ENTRIES", 40)
    stored = content(episode(), 0.1)  # 6 plans of 2 modes and 8 steps are 96 entries
    assert stored["every"] == 3
    (entry,) = stored["agents"][0]["plans"][0]["forecast"]
    np.testing.assert_allclose(numbers(entry["mean"][0]), [0.2, 0.5, 0.8])  # the last is kept


def test_bodies() -> None:
    made = episode()
    discs = Discs(((0.1, 0.0), (-0.1, 0.0)), 0.2)
    outline = Outline(((-0.2, -0.1), (0.2, -0.1), (0.2, 0.1), (-0.2, 0.1)))
    first, second, walker = made.agents
    bodies = replace(first, footprint=discs), replace(second, footprint=outline), walker
    found = content(replace(made, agents=bodies), 0.1)["agents"]
    assert found[0]["parts"] == [
        {"at": [0.1, 0.0], "radius": 0.2}, {"at": [-0.1, 0.0], "radius": 0.2},
    ]  # fmt: skip
    assert found[1]["parts"] == [{"corners": [list(place) for place in outline.vertices]}]
    assert found[2]["parts"] == [{"at": [0.0, 0.0], "radius": 0.3}]
    assert (found[0]["room"], found[1]["room"]) == (0.2, None)


def test_controller_without_plans_and_nobody_to_follow() -> None:
    made = episode()
    blind = replace(made.agents[0], plans=(), speed=np.nan)
    stored = unpacked(packed(replace(made, agents=(blind, made.agents[2])), 0.1))
    assert stored["agents"][0]["plans"] == [] and stored["agents"][0]["reference_speed"] is None
    with pytest.raises(WideberthError, match="no robot"):
        packed(replace(made, agents=made.agents[2:]), 0.1)
    with pytest.raises(WideberthError, match="tail"):
        packed(made, 1.0)


class Tags(HTMLParser):
    def __init__(self, text: str) -> None:
        super().__init__()
        self.found: list[tuple[str, dict[str, str | None]]] = []
        self.feed(text)
        self.close()

    def handle_starttag(self, tag: str, attrs: list[tuple[str, str | None]]) -> None:
        self.found.append((tag, dict(attrs)))


def test_page_is_whole_and_repeats(tmp_path: File) -> None:
    source = tmp_path / "run-a&b<i>-0.npz"
    source.write_bytes(episode().to_bytes())
    page = play(source, tmp_path / "one.html")
    text = page.read_text(encoding="utf-8")
    tags = Tags(text).found
    assert [tag for tag, _ in tags].count("script") == 2  # the packed episode and the player
    assert all(not {"src", "action"} & attributes.keys() for _, attributes in tags)
    assert all(attributes["href"].startswith("data:") for tag, attributes in tags if tag == "link")
    assert "http://" not in text and "https://" not in text and "<i>" not in text
    policy = next(one["content"] for tag, one in tags if tag == "meta" and "http-equiv" in one)
    assert policy is not None and policy.startswith("default-src 'none'")
    assert play(source, tmp_path / "two.html").read_bytes() == page.read_bytes()


def test_finding_an_episode(tmp_path: File) -> None:
    with pytest.raises(WideberthError, match="does not exist"):
        find_episodes(tmp_path / "nothing")
    with pytest.raises(WideberthError, match="keeps no episode"):
        find_episodes(tmp_path)
    files = tmp_path / "files"
    files.mkdir()
    np.savez(files / "other.npz", x=np.zeros(3))
    (files / "a.npz").write_bytes(episode().to_bytes())
    assert find_episodes(tmp_path) == find_episodes(files / "a.npz") == [files / "a.npz"]
    (files / "b.npz").write_bytes(episode().to_bytes())
    assert find_episodes(tmp_path) == [files / "a.npz", files / "b.npz"]
    with pytest.raises(WideberthError, match=r"other.npz: this is not a saved episode"):
        play(files / "other.npz", tmp_path / "x.html")
    assert result_tail(tmp_path) == 0.05
    (tmp_path / "config.yaml").write_text("tail: 0.2\n")
    assert result_tail(tmp_path) == 0.2
    page = play(files / "a.npz", tmp_path / "x.html").read_text()
    (text,) = re.findall(r'data-name="a"[^>]*>(.*?)</script>', page)
    assert unpacked(text)["content"] == 0.8


def test_command(
    tmp_path: File, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.chdir(tmp_path)
    monkeypatch.setattr(os, "environ", dict(os.environ))
    monkeypatch.setattr(sys, "path", list(sys.path))
    opened: list[str] = []
    monkeypatch.setattr("webbrowser.open", lambda address: bool(opened.append(address)))
    File("run-x-0.npz").write_bytes(episode().to_bytes())
    for arguments, code, words in (
        (["play", "run-x-0.npz", "--no-open"], 0, "written: run-x-0.html"),
        (["play", "run-x-0.npz", "--out", "p.html"], 0, "no browser was found"),
        (["play", "absent"], 2, "results/absent does not exist"),
        (["play", "run-x-0.npz", "--no-open", "--tail", "2"], 2, "tail"),
        (["play", "run-x-0.npz", "--no-open", "--out", "no/p.html"], 2, "cannot be written"),
    ):
        with pytest.raises(SystemExit) as end:
            cli.main(arguments)
        printed = capsys.readouterr()
        assert (end.value.code or 0) == code and words in printed.out + printed.err
    assert opened == [(tmp_path / "p.html").as_uri()]


@pytest.mark.skipif(shutil.which("node") is None, reason="needs node")
def test_script_decodes_and_steps_as_the_episode_says() -> None:
    made = episode()
    script = f"""
      const player = require({json.dumps(str(TEMPLATES / PLAYER[0]))});
      const text = require("fs").readFileSync(0, "utf8");
      const plain = require("zlib").inflateSync(Buffer.from(text, "base64"));
      const one = player.decode(JSON.parse(plain));
      const robot = one.agents[0], steps = [];
      let at = 0;
      for (const way of [1, 1, 1, 1, -1, -1, -1, -1]) {{
        at = player.decisionFrom(one, robot, at, way);
        steps.push(one.frames[at]);
      }}
      const stamps = [2.0, 0.0].map((time) => player.planAt(robot, time).stamp);
      const facts = Object.fromEntries(player.facts(one, robot, at));
      const way = {{ best: true, gave_way: "asked 95 %, holds 39 %", level: [1, 2] }};
      const said = [player.verdict(robot.plans[0]), player.verdict(way), player.verdict(null)];
      const grades = [robot.plans[0], way, {{ ...way, gave_way: "" }}].map(player.grade);
      const ticks = [player.ticks(-0.3, 2.1, 5), player.ticks(1, 1, 5), player.ticks(2, 1, 5)];
      const x = robot.positions[0];
      console.log(JSON.stringify({{x, steps, stamps, facts, ticks, said, grades}}));
    """
    done = subprocess.run(
        ["node", "-e", script], input=packed(made, 0.1), capture_output=True, text=True
    )
    assert done.returncode == 0, done.stderr
    found = json.loads(done.stdout)
    times = numbers(content(made, 0.1)["frames"], TIME)
    np.testing.assert_allclose(found["x"], 0.5 * times, atol=0.51 * LENGTH)
    wanted = [*STAMPS, made.duration, 2.9, 1.7, 0.3141, 0.0]
    np.testing.assert_allclose(found["steps"], wanted, atol=1e-6)
    assert found["stamps"] == [1700000, 314100]
    assert found["ticks"] == [[0, 0.5, 1, 1.5, 2], [], []]
    assert found["grades"] == [2, 1, 0]
    assert found["said"] == [
        "Not optimal: shifted last plan.",
        "Optimal, but it gave way: asked 95 %, holds 39 %.",
        "This controller makes no plans.",
    ]
    assert found["facts"]["rung"] == "shifted last plan" and found["facts"]["level"] == "1.5"


@pytest.mark.skipif(shutil.which("node") is None, reason="needs node")
def test_keys_step_wherever_the_focus_is() -> None:
    """A key that the focused element uses itself keeps its use."""
    cases = {
        ("ArrowRight", "own", "SELECT", "select-one"): True,
        ("ArrowLeft", "own", "INPUT", "radio"): True,
        ("ArrowLeft", "own", "INPUT", "range"): True,
        ("ArrowRight", "page", "BODY", ""): True,
        ("ArrowRight", "page", "A", ""): True,
        (" ", "own", "SECTION", ""): True,
        ("End", "own", "SECTION", ""): True,
        ("ArrowDown", "own", "SELECT", "select-one"): False,
        ("ArrowDown", "page", "BODY", ""): False,  # it scrolls
        (" ", "own", "BUTTON", "button"): False,
        ("ArrowRight", "page", "INPUT", "text"): False,
        ("r", "page", "INPUT", "search"): False,
    }
    script = f"""
      const player = require({json.dumps(str(TEMPLATES / PLAYER[0]))});
      const cases = {json.dumps([list(case) for case in cases])};
      console.log(JSON.stringify(cases.map((case_) => player.takesKey(...case_))));
    """
    done = subprocess.run(["node", "-e", script], capture_output=True, text=True)
    assert done.returncode == 0, done.stderr
    assert json.loads(done.stdout) == list(cases.values())


def test_the_play_button_stands_above_the_views() -> None:
    """The views are as tall as the window: below them it would be out of sight at first."""
    template = (TEMPLATES / "player.html").read_text(encoding="utf-8")
    places = [template.index(f'class="{name}"') for name in ("go", "time", "views", "side")]
    assert places == sorted(places)
    areas = re.findall(
        r'grid-template-areas: "(\w+)[^"]*" "(\w+)', (TEMPLATES / "page.css").read_text()
    )
    assert areas == [("controls", "views")] * 2


def test_captions_are_names() -> None:
    """Of runs that differ in the seed alone a bare number would say nothing."""
    one = Recorded("comparison-3", {"scenario": "circle", "seed": "3"}, "", "")
    assert one.label(["seed"]) == "seed 3" and one.label(["scenario"]) == "circle"
