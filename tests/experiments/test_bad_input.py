"""Bad input from the shell: one clear message, exit code 2, nothing half-written, no wait."""

from pathlib import Path

import pytest

from wideberth.experiments.cli import app as cli
from wideberth.framework.values.errors import WideberthError


def refused(arguments: list[str], capsys: pytest.CaptureFixture[str]) -> str:
    """Run the command line and return its one message."""
    with pytest.raises(SystemExit) as stop:
        cli.main(arguments)
    captured = capsys.readouterr()
    assert stop.value.code == 2
    assert "Traceback" not in captured.err + captured.out
    message = captured.err.strip()
    assert message.startswith("Error: ")
    return message


@pytest.mark.parametrize(
    ("override", "words"),
    [
        ("robot.radius=-1", "radius"),
        ("robot.radis=1", "did you mean"),
        ("robot.radius=wide", "robot.radius"),
        ("robot=unicicle", "unicycle"),
        ("planners.default.horizon=0", "horizon"),
        ("planners.default.level.tail=1.5", "tail"),
        ("planners.default.level.tail=0", "tail"),
        ("planners.default.predictor=kallman", "kalman"),
        ("planners.default.dt=.nan", "dt"),
        ("planners.default.solver.tolerance=-1", "tolerance"),
        ("scenario.distance=[20, 12]", "distance"),
        ("settings.channel.dropout=1.0", "dropout"),
        ("settings.time_limit=0", "time_limit"),
        ("seeds=0", "seeds"),
        ("seeds=two", "seeds"),
        ("sedes=2", "did you mean"),
        ("planners.default.region=mypackage:Box", "mypackage"),
    ],
)
def test_a_bad_setting(
    override: str, words: str, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    out = tmp_path / "out"
    message = refused(["run", "crossing", "--set", override, "--out", str(out)], capsys)
    assert words in message
    assert not out.exists()


@pytest.mark.parametrize(
    ("content", "words"),
    [
        (b"", "mapping"),
        (b"- a\n- b\n", "mapping"),
        (b"\x00\xff\xfe\x01", ""),
        (b"type: [unclosed", ""),
        (b"type: encounter\n", "robot"),
    ],
)
def test_a_bad_config_file(
    content: bytes, words: str, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    config = tmp_path / "config.yaml"
    config.write_bytes(content)
    message = refused(["run", str(config), "--out", str(tmp_path / "out")], capsys)
    assert words in message
    assert "config.yaml" in message or words == "robot"
    assert not (tmp_path / "out").exists()


def test_a_folder_that_holds_something_else(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    (tmp_path / "notes.txt").write_text("mine")
    message = refused(["run", "crossing", "--out", str(tmp_path)], capsys)
    assert "--out" in message
    assert (tmp_path / "notes.txt").read_text() == "mine"


def test_a_place_that_cannot_be_written(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    blocking = tmp_path / "file"
    blocking.write_text("")
    message = refused(["run", "crossing", "--out", str(blocking / "out")], capsys)
    assert "--out" in message


@pytest.mark.parametrize("command", [["run", "crosing"], ["list", "regionz"], ["cite", "crosing"]])
def test_an_unknown_name(command: list[str], capsys: pytest.CaptureFixture[str]) -> None:
    assert "did you mean" in refused(command, capsys)


def test_the_error_type_is_a_value_error() -> None:
    assert issubclass(WideberthError, ValueError)
