"""Commands that write one file replace files of their own kind, and no others."""

from pathlib import Path

import pytest

from wideberth.experiments.cli.app import main
from wideberth.experiments.report.document import report
from wideberth.experiments.report.player import MARK, find_episodes, page, play
from wideberth.framework.plugins.config import save_plugin
from wideberth.framework.plugins.io import check_target
from wideberth.framework.values.errors import WideberthError
from wideberth.predictors.kalman import Kalman
from wideberth.tests.helpers.saved import SAVED


def test_a_saved_predictor_replaces_only_another(tmp_path: Path) -> None:
    path = save_plugin(tmp_path / "a.json", "predictors", Kalman(speed=0.3))
    save_plugin(path, "predictors", Kalman(speed=0.4))
    for other in ("thesis.tex", "other.json"):
        mine = tmp_path / other
        mine.write_text('{"format": "mine"}')
        with pytest.raises(WideberthError, match=r"is another file, which is not replaced.*--out"):
            save_plugin(mine, "predictors", Kalman())
        assert mine.read_text() == '{"format": "mine"}'
    (tmp_path / "link.json").symlink_to(path)
    with pytest.raises(WideberthError, match=r"is a symbolic link"):
        save_plugin(tmp_path / "link.json", "predictors", Kalman())
    assert (tmp_path / "link.json").is_symlink()


def test_a_report_does_not_replace_notes_of_the_same_name(tmp_path: Path) -> None:
    (tmp_path / "thesis.md").write_text("mine")
    with pytest.raises(WideberthError, match=r"thesis\.md is another file"):
        report([tmp_path / "no result"], tmp_path / "thesis.md")
    assert (tmp_path / "thesis.md").read_text() == "mine"


def test_a_player_does_not_replace_another_page(tmp_path: Path) -> None:
    (tmp_path / "run.html").write_text("<!DOCTYPE html>mine")
    with pytest.raises(WideberthError, match=r"run\.html is another file"):
        play(tmp_path / "run.npz", tmp_path / "run.html")


@pytest.mark.parametrize("through", [True, False])
def test_a_film_does_not_replace_another_file(
    tmp_path: Path, capsys: pytest.CaptureFixture[str], through: bool
) -> None:
    """Be it behind a link: a result of someone else may hold one with the name of the film."""
    (tmp_path / "thesis.gif").write_text("mine")
    (tmp_path / "link.gif").symlink_to("thesis.gif")
    (episode, *_) = find_episodes(SAVED / "result")
    out = tmp_path / ("link.gif" if through else "thesis.gif")
    with pytest.raises(SystemExit) as left:
        main(["film", str(episode), "--out", str(out)])
    assert left.value.code == 2 and "not replaced" in " ".join(capsys.readouterr().err.split())
    assert (tmp_path / "thesis.gif").read_text() == "mine"


def test_a_page_carries_the_mark_where_it_is_looked_for(tmp_path: Path) -> None:
    path = tmp_path / "page.html"
    path.write_text(page("x" * 300, ()))
    check_target(path, MARK)


@pytest.mark.parametrize(
    ("name", "words"),
    [("", "is a folder"), ("no/x", "its folder does not exist"), ("x" * 300, "cannot be written")],
)
def test_places_for_no_file(name: str, words: str, tmp_path: Path) -> None:
    with pytest.raises(WideberthError, match=words):
        check_target(tmp_path / name, "mark")
