"""Films in space: what is where in a picture, and what is said where nothing can be drawn."""

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from PIL import Image

from wideberth import WideberthError
from wideberth.experiments.cli import app as cli
from wideberth.framework.values.polygon import Polygon
from wideberth.simulation.drawing import artists
from wideberth.simulation.log.episode_log import Episode
from wideberth.tests.helpers.player_samples import episode
from wideberth_perception.physics import film as module
from wideberth_perception.physics.body import HULL_TOP
from wideberth_perception.physics.film import film

pytest.importorskip("mujoco", reason="pip install 'wideberth[perception]'")
SIZE = (96, 60)


@pytest.fixture
def drawing() -> None:
    """Skip where nothing can draw without a screen."""
    try:
        module._screen(SIZE).free()
    except WideberthError as error:
        pytest.skip(str(error))


@pytest.fixture
def nothing(monkeypatch: pytest.MonkeyPatch) -> None:
    """Take away all that could draw."""
    monkeypatch.setattr(module, "PLATFORMS", ("crayon",))


@pytest.mark.usefixtures("drawing")
def test_bodies_are_seen_where_they_were() -> None:
    """Seen from straight above, the middle of a robot's pixels is its place."""
    made = episode(2)
    log = made.robots[0]
    made = replace(made, agents=(log,), polygons=())
    stage = module._Stage(made, (480, 300), 90.0)
    low, high = artists.extent(made)
    for time in (0.0, 0.4 * made.duration):
        picture = stage.picture(time).astype(float)
        blue = picture[..., 2] - picture[..., 0] > 40.0
        assert blue.any()
        place = made.at(log, np.array([time]))[0]
        # m per pixel at the height of the hulls' tops, by the camera's height and field of view
        across = 2.0 * (stage._camera.distance - HULL_TOP) * np.tan(np.radians(22.5)) / 300
        rows, columns = np.nonzero(_body(blue))
        seen = 0.5 * (low + high) + across * np.array(
            [columns.mean() - 239.5, 149.5 - rows.mean()]
        )
        assert np.abs(seen - place).max() < 0.3 * log.radius


def _body(mask: np.ndarray) -> np.ndarray:
    """Leave out lines and dots: pixels whose neighbours four away are all of the colour."""
    found = mask.copy()
    for axis in (0, 1):
        for shift in (-4, 4):
            found &= np.roll(mask, shift, axis)
    return found


@pytest.mark.usefixtures("drawing")
def test_walls_are_seen_and_a_second_film_changes_nothing() -> None:
    made = replace(episode(2), polygons=())
    low, high = artists.extent(made)
    middle = 0.5 * (low + high)
    crate = Polygon([middle + 0.4 * np.array(c) for c in ((-1, -1), (1, -1), (1, 1), (-1, 1))])
    walled = replace(made, polygons=(crate,))
    pictures = []
    for _ in range(2):
        stage, other = module._Stage(walled, SIZE, 90.0), module._Stage(made, SIZE, 90.0)
        pictures.append(np.abs(stage.picture(0.0) - other.picture(0.0).astype(float)))
        del stage, other
    assert pictures[0][28:32, 46:50].min(axis=(0, 1)).max() > 10.0
    assert np.array_equal(*pictures)


@pytest.mark.usefixtures("drawing")
def test_a_film_is_written(tmp_path: Path) -> None:
    file = tmp_path / "film.gif"
    made = episode(2)
    film(made, rate=2.0, speed=made.duration, size=SIZE).save(file)
    with Image.open(file) as images:
        assert images.size == SIZE and images.n_frames == 3


@pytest.mark.usefixtures("nothing")
def test_where_nothing_draws_the_command_films_from_above(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    made = episode(2)
    with pytest.raises(
        WideberthError, match=r"install EGL .* episode.animate\(\). crayon: Module"
    ):
        film(made)
    (tmp_path / "one.npz").write_bytes(made.to_bytes())
    out = tmp_path / "film.gif"
    with pytest.raises(SystemExit) as left:
        cli.main(["film", str(tmp_path / "one.npz"), "--out", str(out)])
    assert left.value.code == 0
    said = capsys.readouterr().out
    assert "It is filmed from above instead." in said and "written: " in said
    with Image.open(out) as images:
        assert images.n_frames == round(10.0 * made.duration / 4.0) + 1


def test_what_cannot_be_filmed_is_refused() -> None:
    made = episode(2)
    with pytest.raises(WideberthError, match=r"size is \(10, 10\); wanted 16 x 16"):
        film(made, size=(10, 10))
    with pytest.raises(WideberthError, match="elevation is 0; wanted degrees above 0"):
        film(made, elevation=0.0)
    with pytest.raises(WideberthError, match="rate is 0"):
        film(made, rate=0.0)
    with pytest.raises(WideberthError, match="this episode has none, or they fly"):
        film(episode(3))
    alone = Episode(made.times, made.agents[2:], made.ended, made.goal_tolerance, made.seed)
    with pytest.raises(WideberthError, match="this episode has none, or they fly"):
        film(alone)
