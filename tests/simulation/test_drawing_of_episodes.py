"""Episodes draw themselves, as a picture, as a film, and while they run."""

import re
from base64 import b64decode
from io import BytesIO
from pathlib import Path as File

import matplotlib
import numpy as np
import pytest
from matplotlib import pyplot
from matplotlib.animation import FFMpegWriter
from matplotlib.figure import Figure

from wideberth import Path, WideberthError, draw, recommended
from wideberth.draw.plans import kept_out
from wideberth.simulation.drawing import artists, film, watch
from wideberth.simulation.drawing.film import FilmStage
from wideberth.simulation.drawing.saving import writer_for
from wideberth.simulation.drawing.watch import WatchWindow
from wideberth.simulation.engine.agents import ReplayAgent, RobotAgent
from wideberth.simulation.engine.episode import run_episode, watched
from wideberth.simulation.engine.settings import Settings
from wideberth.simulation.log.episode_log import Episode


def crossing(size: int) -> Episode:
    """A robot passes a walker in the plane, or a ball in space."""
    planner = recommended("unicycle" if size == 2 else "holonomic_3d", 1.0, quiet=True)
    path = Path(np.pad([[0.0], [3.0]], ((0, 0), (0, size - 1))))
    way = np.zeros((40, size))
    way[:, 0], way[:, 1] = 2.5, np.linspace(-3.0, 3.0, 40)
    walker = ReplayAgent("walker", np.linspace(-3.0, 6.0, 40), way, 0.3)
    robot = RobotAgent("robot", planner.robot, planner, path, 1.0)
    return run_episode([robot], Settings(time_limit=2.0, history=2.0), others=[walker])


@pytest.fixture(scope="module")
def episode() -> Episode:
    return crossing(2)


def test_a_picture_shows_the_ways_and_the_closest_approach(episode: Episode) -> None:
    before, backend = dict(matplotlib.rcParams), matplotlib.get_backend()
    panel = episode.plot()
    assert (dict(matplotlib.rcParams), matplotlib.get_backend()) == (before, backend)
    ways = [line.get_xydata() for line in panel.lines]
    for log in episode.agents:
        assert any(np.array_equal(way, log.positions) for way in ways if len(way) > 9)
    assert any("least clearance" in text for text in panel.get_legend_handles_labels()[1])
    assert episode._repr_png_().startswith(b"\x89PNG")
    assert repr(episode).splitlines()[0].startswith("Episode(1 robot, 1 replay; 2 s, ended by")
    assert len(repr(episode)) < 200 and len(repr(episode.robots[0])) < 100


def test_a_picture_in_space() -> None:
    panel = crossing(3).plot()
    assert panel.name == "3d" and panel.get_zlabel() == "z (m)"


def test_a_saved_episode_draws_the_same_plans(episode: Episode) -> None:
    again = Episode.from_bytes(episode.to_bytes())
    assert again.to_bytes() == episode.to_bytes()
    for one, other in zip(episode.robots[0].plans, again.robots[0].plans, strict=True):
        steps = [0, 7]
        rims, same = (kept_out(plan, plan.situation, steps) for plan in (one, other))
        assert rims.keys() == same.keys() == {(0, 0)}
        assert np.array_equal(rims[0, 0], same[0, 0])
    pictures = []
    for plan in (one, other):
        figure, buffer = Figure(), BytesIO()
        draw.plan(plan, figure.add_subplot())
        figure.savefig(buffer, format="rgba")
        pictures.append(buffer.getvalue())
    assert pictures[0] == pictures[1]


def test_a_film_is_written(episode: Episode, tmp_path: File) -> None:
    from PIL import Image

    before = dict(matplotlib.rcParams)
    one = episode.animate(rate=4.0, speed=2.0)
    one.save(tmp_path / "film.gif")
    with Image.open(tmp_path / "film.gif") as written:
        assert written.n_frames == 5
    assert dict(matplotlib.rcParams) == before
    with pytest.raises(WideberthError, match=r"opens no window.*MPLBACKEND"):
        episode.animate(live=True)
    with pytest.raises(WideberthError, match="rate"):
        episode.animate(rate=0.0)


def test_a_film_plays_in_a_notebook(episode: Episode, monkeypatch: pytest.MonkeyPatch) -> None:
    from PIL import Image

    page = episode.animate(rate=2.0, speed=2.0)._repr_html_()
    assert page is not None
    (data,) = re.findall('src="data:image/gif;base64,([^"]+)"', page)
    with Image.open(BytesIO(b64decode(data))) as shown:
        assert shown.n_frames == 3 and shown.info["loop"] == 0  # at 0 s, 1 s and 2 s, endlessly
    with matplotlib.rc_context({"animation.html": "jshtml"}):
        assert "<script" in str(episode.animate(rate=1.0, speed=2.0)._repr_html_())
    with monkeypatch.context() as screen:
        screen.setattr(film, "window", lambda: pyplot.figure(dpi=50))
        screen.setattr(Figure, "show", lambda self: None)
        live = episode.animate(live=True)
    assert live._repr_html_() is None
    live._draw_was_started = True  # matplotlib warns of films that nobody draws


def test_a_film_names_the_program_that_it_lacks(
    episode: Episode,
    tmp_path: File,
    monkeypatch: pytest.MonkeyPatch,
    caplog: pytest.LogCaptureFixture,
    capfd: pytest.CaptureFixture[str],
) -> None:
    monkeypatch.setattr(FFMpegWriter, "isAvailable", classmethod(lambda cls: False))
    one = episode.animate(rate=2.0, speed=2.0)
    with pytest.raises(WideberthError, match=r"film\.mp4 .* by ffmpeg, .* film\.gif"):
        one.save(tmp_path / "film.mp4")
    one.save(str(tmp_path / "film.GIF"))
    assert [file.name for file in tmp_path.iterdir()] == ["film.GIF"]
    assert not caplog.records and capfd.readouterr() == ("", "")
    monkeypatch.setattr(FFMpegWriter, "isAvailable", classmethod(lambda cls: True))
    assert (writer_for(File("a.mp4")), writer_for(File("a.gif"))) == ("ffmpeg", "pillow")


def test_figures_write_a_minus_sign(episode: Episode, monkeypatch: pytest.MonkeyPatch) -> None:
    found = artists.closest(episode)
    assert found is not None
    touching = lambda episode: found._replace(clearance=-0.25)  # noqa: E731
    monkeypatch.setattr(artists, "closest", touching)
    labels = episode.plot().get_legend_handles_labels()[1]
    assert [text for text in labels if text.split("\n")[-1].startswith("\u22120.25 m at")]


def test_a_window_follows_a_run_and_changes_nothing(
    episode: Episode, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(film, "window", lambda: pyplot.figure(dpi=50))
    monkeypatch.setattr(Figure, "show", lambda self: None)
    monkeypatch.setattr(watch, "monotonic", lambda: 0.0)  # draws in no time
    window = WatchWindow(every=0.5)
    with watched(window):
        same = crossing(2)
    assert same.to_bytes() == episode.to_bytes()
    assert window.shown == pytest.approx(2.0, abs=0.51)
    assert window.stage is not None
    body = window.stage.actors[0].body.get_paths()[0].vertices
    place = same.robots[0].positions[np.searchsorted(same.times, window.shown)]
    assert np.allclose(np.linalg.norm(body - place, axis=1), same.robots[0].radius, atol=1e-6)
    window._close(None)
    shown = window.shown
    with watched(window):
        crossing(2)
    assert window.shown == shown


def test_drawing_takes_no_more_than_half_of_the_time(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(film, "window", lambda: pyplot.figure(dpi=50))
    monkeypatch.setattr(Figure, "show", lambda self: None)
    now = [0.0]

    def clock() -> float:
        now[0] += 1.0
        return now[0]

    def draw(stage: FilmStage, episode: Episode) -> None:
        now[0] += 5.0
        drawn.append(episode.duration)

    drawn: list[float] = []
    monkeypatch.setattr(watch, "monotonic", clock)
    monkeypatch.setattr(FilmStage, "follow", draw)
    with watched(WatchWindow(every=0.0)):
        crossing(2)
    assert len(drawn) > 1
    assert 2 * 6.0 * (len(drawn) - 1) <= now[0]
