"""A recorded solve opens the exact problem again, says what happened, and stays out of the way."""

import json
import subprocess
import sys
from dataclasses import replace
from pathlib import Path as File
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest
from typer.testing import CliRunner

from wideberth.controllers.diagnosis import explain
from wideberth.controllers.diagnosis.explain import SolveRecord
from wideberth.controllers.diagnosis.solve_record import Record, read_solve, write_solve
from wideberth.experiments.cli.app import app
from wideberth.framework.mpc.planner.planner import Planner
from wideberth.framework.mpc.planner.rungs import Fallback
from wideberth.framework.plugins.config import build, describe
from wideberth.framework.robot import start_state
from wideberth.framework.values.errors import WideberthError
from wideberth.framework.values.motion import Detection, Observation
from wideberth.framework.values.path import Path
from wideberth.framework.values.plan import GivenWay, Plan, Rung, Status
from wideberth.framework.values.polygon import Polygon
from wideberth.solvers.fatrop import Fatrop

PLAIN: dict[str, Any] = {
    "type": "mpc",
    "robot": "unicycle",
    "predictor": "static",
    "region": "mahalanobis_ellipse",
    "level": {"type": "relaxed", "weight": 100.0},
    "solver": "fatrop",
    "penalty": 1e4,
    "starts": "auto",
}
KINDS: dict[str, dict[str, Any]] = {
    "plain": {},
    "ipopt": {"solver": "ipopt", "penalty": None},
    "exact sum": {"region": "minkowski_sum", "level": "fixed", "fallback": {"stop_at_end": True}},
    "walls": {"static_region": "separating_line"},
    "contouring": {"cost": "contouring", "robot": "differential_drive"},
    "flying": {"robot": "holonomic_3d"},
}
HUT = Polygon(((3.0, 1.2), (4.0, 1.2), (4.0, 2.2), (3.0, 2.2)), "hut")


def planner(**changes: Any) -> Planner:
    made: Planner = build("controllers", {**PLAIN, **changes})
    way = np.zeros((2, made.robot.dimension))
    way[1, 0] = 20.0
    made.set_path(Path(way))
    return made


def ahead(made: Planner, *others: tuple[str, float, float], time: float = 0.0) -> Observation:
    size = made.robot.dimension
    state, _ = start_state(made.robot, [0.0] * size, np.eye(size)[0], 0.5)
    detections = tuple(
        Detection(name, np.array([x, y, 0.0][:size]), 1e-4 * np.eye(size), 0.5)
        for name, x, y in others
    )
    polygons = () if made.static_region is None else (HUT,)
    return Observation(time, np.array(state), detections, polygons=polygons)


def decided(made: Planner, observation: Observation) -> Plan:
    made.command(observation)
    assert made.plan is not None
    return made.plan


@pytest.mark.parametrize("kind", KINDS)
def test_a_reopened_problem_gives_the_same_solution_to_the_byte(kind: str, tmp_path: File) -> None:
    made = planner(**KINDS[kind])
    plan = decided(made, ahead(made, ("a", 4.0, 0.2), ("b", 9.0, -3.0)))
    assert plan.rung is Rung.OPTIMAL
    kept = made.explain()
    again = read_solve(write_solve(tmp_path / "one", kept))
    assert again.key == kept.key and again.verdict == kept.verdict and again.names == kept.names
    assert again.problem().key == kept.key
    solutions = again.again()
    assert len(solutions) == len(kept.guesses) > 1
    best = min(solutions, key=lambda one: one.cost)
    assert best.status is Status.SOLVED
    np.testing.assert_array_equal(best.point.states, kept.point.states)
    np.testing.assert_array_equal(best.point.inputs[:, : plan.inputs.shape[1]], plan.inputs)
    assert best.cost == plan.cost == again.verdict.cost


@pytest.mark.parametrize(("ends", "rounds"), [((), 1), (("given up: dearer",), 2)])
def test_starts_are_given_up_again_where_some_were(
    ends: tuple[str, ...], rounds: int, monkeypatch: pytest.MonkeyPatch
) -> None:
    made = planner(**next(iter(KINDS.values())))
    decided(made, ahead(made, ("a", 4.0, 0.2)))
    kept, asked = replace(made.explain(), ends=ends), []
    assert len(kept.guesses) > 1

    def solve(solver: Any, problem: Any, parameters: Any, guesses: Any, *_: Any) -> list[Any]:
        asked.append(len(guesses))
        return [None] * len(guesses)

    monkeypatch.setattr(Fatrop, "solve", solve)
    monkeypatch.setattr(explain, "solve_cheapest", solve)
    assert len(kept.again(Fatrop())) == len(kept.guesses)
    assert asked == ([len(kept.guesses)] if rounds == 1 else [1, len(kept.guesses) - 1])


def test_another_process_opens_the_same_problem(tmp_path: File) -> None:
    made = planner()
    plan = decided(made, ahead(made, ("a", 4.0, 0.2)))
    file = write_solve(tmp_path / "one", made.explain())
    script = (
        "from wideberth.controllers.diagnosis.solve_record import read_solve\n"
        f"best = min(read_solve({str(file)!r}).again(), key=lambda one: one.cost)\n"
        "print(best.point.states.tobytes().hex())"
    )
    done = subprocess.run(
        [sys.executable, "-c", script], capture_output=True, text=True, check=True
    )
    assert done.stdout.strip() == plan.states.tobytes().hex()


def test_the_text_says_what_happened() -> None:
    made = planner()
    plan = decided(made, ahead(made, ("far", 5.0, 0.0), ("near", 0.9, 0.1)))
    assert plan.breach is not None
    text = made.explain().text()
    for words in (str(plan.rung), str(plan.breach), "2 obstacles in 2 slots", "unicycle"):
        assert words in text
    table = text.splitlines()[5:]
    assert (
        table[0]
        .strip()
        .startswith(f"region of 'near' by {plan.breach.amount:.3g} at step {plan.breach.step}")
    )
    made = planner()
    fine = decided(made, ahead(made, ("far", 9.0, 3.0)))
    assert fine.rung is Rung.OPTIMAL
    assert "nothing went wrong" in made.explain().text()
    assert "keeps every constraint" in made.explain().text()
    said = repr(made.explain())
    assert (
        said.startswith("SolveRecord(plan at 0 s: optimal, solver: solved; ") and len(said) < 120
    )


def test_nothing_solved_is_nothing_to_explain() -> None:
    made = planner()
    with pytest.raises(WideberthError, match="none to explain"):
        made.explain()
    made.command(ahead(made))
    assert made.explain().names == ()
    made.command(Observation(0.5, np.full(5, np.nan)))
    with pytest.raises(WideberthError, match="reason says why"):
        made.explain()


def test_failed_and_slow_solves_are_kept_up_to_a_number(tmp_path: File) -> None:
    folder = tmp_path / "new" / "solves"
    made = planner(record={"folder": str(folder), "most": 3})
    assert decided(made, ahead(made, ("far", 9.0, 3.0))).rung is Rung.OPTIMAL
    assert not folder.exists()  # the warm-up leaves nothing either
    for k in range(5):
        plan = decided(made, ahead(made, ("a", 0.9, 0.1 + 0.01 * k), time=0.5 * (k + 1)))
        assert plan.rung is not Rung.OPTIMAL and "not recorded" not in plan.reason
    files = sorted(folder.glob("*.json"))
    assert len(files) == len(list(folder.glob("*.npz"))) == 3
    assert {file.suffix for file in folder.iterdir()} == {".json", ".npz"}
    assert "'a'" in read_solve(files[0]).verdict.reason
    slow = planner(record={"folder": str(tmp_path / "slow"), "slower_than": 0.0})
    decided(slow, ahead(slow))
    assert read_solve(next((tmp_path / "slow").glob("*.json"))).verdict.rung == "optimal"


def test_a_folder_that_cannot_be_written_is_a_reason(tmp_path: File) -> None:
    (tmp_path / "taken").write_text("a file")
    made = planner(record={"folder": str(tmp_path / "taken"), "slower_than": 0.0})
    plan = decided(made, ahead(made, ("a", 4.0, 0.2)))
    assert plan.rung is Rung.OPTIMAL
    assert "not recorded: " in plan.reason
    for change in ({"slower_than": -1.0}, {"most": 0}):
        with pytest.raises(WideberthError, match="record"):
            Record("x", **change)  # type: ignore[arg-type]


def test_the_settings_are_config() -> None:
    made = planner(
        record={"folder": "solves"}, fallback=Fallback(stop_at_end=True), starts=["along", "wait"]
    )
    again: Planner = build("controllers", describe(made))
    assert again.record == Record("solves")
    assert again.fallback.stop_at_end and again.starts == ("along", "wait")
    assert describe(again) == describe(made)


def test_files_that_are_damaged_or_of_another_kind_are_refused(tmp_path: File) -> None:
    made = planner()
    made.command(ahead(made, ("a", 4.0, 0.2)))
    kept = made.explain()
    file = write_solve(tmp_path / "one.json", kept)
    numbers, content = file.with_suffix(".npz"), json.loads(file.read_text())
    assert write_solve(tmp_path / "two", kept).with_suffix(".npz").read_bytes() == (
        numbers.read_bytes()
    )
    other = {**content, "planner": {**content["planner"], "horizon": 14}}
    for change, words in (
        ({**content, "version": 3}, "version 3"),
        ({**content, "format": "wideberth/episode"}, "has format"),
        ({key: content[key] for key in ("format", "version")}, "damaged"),
        ({**content, "starts": 99}, "damaged"),
    ):
        file.write_text(json.dumps(change))
        with pytest.raises(WideberthError, match=words):
            read_solve(file)
    file.write_text(json.dumps(other))
    with pytest.raises(WideberthError, match="another one than was solved"):
        read_solve(file).problem()
    file.write_text(json.dumps(content))
    numbers.write_bytes(numbers.read_bytes()[:200])
    with pytest.raises(WideberthError, match="damaged"):
        read_solve(file)
    numbers.unlink()
    with pytest.raises(WideberthError, match="pair of files"):
        read_solve(numbers)
    with pytest.raises(WideberthError, match="cannot be read"):
        read_solve(tmp_path / "none")
    odd = replace(kept, planner={**kept.planner, "robot": object()})
    with pytest.raises(WideberthError, match="no plain value"):
        write_solve(tmp_path / "odd", odd)


def test_the_command_line_explains_files_and_folders(tmp_path: File) -> None:
    made = planner(record={"folder": str(tmp_path)})
    for k in range(2):
        made.command(ahead(made, ("a", 0.9, 0.1 + 0.01 * k), time=0.5 * k))
    first = sorted(tmp_path.glob("*.npz"))[0]
    one = CliRunner().invoke(app, ["explain", str(first), "--solver", "ipopt"])
    assert one.exit_code == 0, one.output
    assert "region of 'a'" in one.output and "solved again with ipopt:" in one.output
    assert "Solve_Succeeded" in one.output
    both = CliRunner().invoke(app, ["explain", str(tmp_path)])
    assert both.output.count("the recorded solver") == 2
    empty = tmp_path / "empty"
    empty.mkdir()
    assert "no recorded solve" in str(CliRunner().invoke(app, ["explain", str(empty)]).exception)


def test_a_record_says_what_its_plan_says() -> None:
    way = GivenWay(0.05, 0.4, "content", 3, "a")
    for given in (None, way):
        plan = SimpleNamespace(
            stamp=1.0, status=Status.SOLVED, rung=Rung.OPTIMAL, reason="why", iterations=4,
            violation=0.1, cost=2.0, given_way=given,
        )  # fmt: skip
        instance = SimpleNamespace(
            around=SimpleNamespace(chosen=(SimpleNamespace(room=(2,)),)), asked=None,
            problem=SimpleNamespace(key="k"), names=("a", "?"),
        )  # fmt: skip
        solved: Any = SimpleNamespace(
            plan=plan, instance=instance, guesses=(), point=None, seconds=0.3, ends=()
        )
        found = SolveRecord.of(planner(), solved)
        told = found.verdict
        assert (told.stamp, told.status, told.rung) == (1.0, "solved", "optimal")
        assert (told.reason, told.iterations, told.seconds) == ("why", 4, 0.3)
        assert (told.violation, told.cost) == (0.1, 2.0)
        assert told.given_way == ("" if given is None else str(way))
        assert (found.rooms, found.key, found.names) == (((2,),), "k", ("a", "?"))
