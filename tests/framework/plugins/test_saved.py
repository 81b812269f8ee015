"""What is saved comes back equal; what is damaged, newer or of another room is refused."""

import json
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any, final

import numpy as np
import pytest

from wideberth.experiments.engine.shipped_configs import read_experiment
from wideberth.framework.plugins import registry
from wideberth.framework.plugins.config import build, describe, load_plugin, save_plugin
from wideberth.framework.plugins.registry import ROOMS, load, names, register
from wideberth.framework.plugins.yamlfile import dump, parse, read_config
from wideberth.framework.predictor import Predictor
from wideberth.framework.values.errors import WideberthError
from wideberth.framework.values.forecast import Forecast, Scene
from wideberth.framework.values.tracks import Tracks
from wideberth.predictors.kalman import Kalman
from wideberth.predictors.static import Static
from wideberth.predictors.var import VectorAutoregression
from wideberth.robots.unicycle import Unicycle


@dataclass(frozen=True)
class Table:
    rows: tuple[tuple[float, ...], ...]
    windows: int


@final
@dataclass(frozen=True)
class Learner(Predictor):
    """Holds learnt numbers as fitted predictors do."""

    fitted: Table | None = None
    base: Predictor = field(default_factory=Static)
    odd: Any = None

    def predict(self, tracks: Tracks, steps: int, scene: Scene | None = None) -> Forecast:
        return self.base.predict(tracks, steps, scene)


@pytest.fixture(autouse=True)
def _place(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(tmp_path)
    monkeypatch.setattr(registry, "_registered", {room: {} for room in ROOMS})
    register("predictors", "learner")(Learner)


def learner() -> Learner:
    rows = tuple(map(tuple, np.random.default_rng(0).normal(size=(3, 4)).tolist()))
    return Learner(Table(((0.1, 1e-300, -0.0, 5e300), *rows), 17), Kalman(speed=0.1 + 0.2))


@pytest.mark.parametrize("name", names("predictors"))
def test_every_predictor_comes_back_equal(name: str) -> None:
    predictor = load("predictors", name)()
    again = load_plugin(save_plugin("p.json", "predictors", predictor), "predictors")
    assert type(again) is type(predictor) and describe(again) == describe(predictor)


def test_learnt_numbers_come_back_to_the_last_digit() -> None:
    made = learner()
    again = load_plugin(save_plugin("p.json", "predictor", made), "predictor")
    assert again == made and repr(again) == repr(made)
    first = Path("p.json").read_bytes()
    save_plugin("p.json", "predictor", again)
    assert Path("p.json").read_bytes() == first
    head = json.loads(first)
    assert (head["format"], head["version"]) == ("wideberth/plugin", 1)
    assert head["room"] == "predictors" and head["plugin"]["type"] == "learner"


def test_any_room_is_served() -> None:
    robot = Unicycle(radius=0.4)
    assert load_plugin(save_plugin("r.json", "robot", robot), "robots") == robot


def test_a_config_may_name_the_file_anywhere() -> None:
    save_plugin("p.json", "predictor", learner())
    assert build("predictors", {"saved": "p.json"}) == learner()
    outer = build("predictors", {"type": "var", "fallback": {"saved": "p.json"}})
    assert outer == VectorAutoregression(fallback=learner())
    # what is described of it stands on its own: the file may go
    Path("p.json").unlink()
    assert build("predictors", parse(dump(describe(outer)), "again")) == outer


def test_an_override_and_an_experiment_may_name_it() -> None:
    save_plugin("p.json", "predictor", VectorAutoregression(max_speed=3.25))
    Path("c.yaml").write_text("predictor: kalman\n")
    config = read_config(Path("c.yaml"), ["predictor={saved: p.json}"])
    assert build("predictors", config["predictor"]).max_speed == 3.25
    override = "planners.default.predictor={saved: p.json}"
    experiment, _ = read_experiment("crossing", [override])
    assert describe(experiment)["planners"]["default"]["predictor"]["max_speed"] == 3.25


@pytest.mark.parametrize(
    ("config", "words"),
    [
        ({"saved": "p.json", "speed": 1.0}, "with no other key"),
        ({"saved": 3}, r"wanted \{saved: FILE\}"),
        ({"saved": "none.json"}, "saved: none.json cannot be read"),
    ],
)
def test_the_place_in_the_config_is_named(config: dict[str, Any], words: str) -> None:
    save_plugin("p.json", "predictor", Static())
    with pytest.raises(WideberthError, match=words) as caught:
        build("predictors", config, "planner.predictor")
    assert str(caught.value).startswith("planner.predictor")


def change(**entries: Any) -> None:
    save_plugin("p.json", "predictor", learner())
    content = json.loads(Path("p.json").read_text())
    Path("p.json").write_text(json.dumps({**content, **entries}))


@pytest.mark.parametrize(
    ("entries", "words"),
    [
        ({"version": 2}, "version 2; this package reads 1 to 1"),
        ({"version": "1"}, "version '1'"),
        ({"format": "wideberth/plan"}, "format 'wideberth/plan'"),
        ({"room": "robots"}, "of 'robots'; wanted one of 'predictors'"),
        ({"plugin": None}, "damaged"),
        ({"plugin": {"speed": 1.0}}, "damaged"),
        ({"plugin": {"type": "kalmann"}}, "did you mean 'kalman'"),
        ({"plugin": {"type": "kalman", "speed": "fast"}}, "speed"),
        ({"plugin": {"type": "learner", "fitted": {"rows": [[1, "x"]], "windows": 1}}}, "rows"),
    ],
)
def test_damage_is_named(entries: dict[str, Any], words: str) -> None:
    change(**entries)
    with pytest.raises(WideberthError, match=words) as caught:
        load_plugin("p.json", "predictor")
    assert "p.json" in str(caught.value)


@pytest.mark.parametrize("content", [b"", b"\xff\xfe\x00", b'{"format": "wideberth/pl', b"[1]"])
def test_files_of_another_kind_are_refused(content: bytes) -> None:
    Path("p.json").write_bytes(content)
    with pytest.raises(WideberthError, match=r"p\.json"):
        load_plugin("p.json", "predictor")


def test_what_does_not_survive_is_not_saved() -> None:
    save_plugin("p.json", "predictor", learner())
    before = Path("p.json").read_bytes()
    with pytest.raises(WideberthError, match="learner cannot be saved"):
        save_plugin("p.json", "predictor", replace(learner(), odd=len))
    with pytest.raises(WideberthError, match="cannot be saved"):
        save_plugin("p.json", "robot", learner())
    with pytest.raises(WideberthError, match="is no plug-in"):
        save_plugin("p.json", "predictor", Table((), 0))
    with pytest.raises(WideberthError, match=r"none/p\.json cannot be written"):
        save_plugin("none/p.json", "predictor", Static())
    assert Path("p.json").read_bytes() == before
