"""Our planner in other people's arenas: the arm against a made-up robot_sf, tables, rows."""

import csv
import json
from importlib import import_module
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest
import shapely

from wideberth.framework.plugins.io import write_text

ROOT = Path(__file__).resolve().parents[2]
ARENAS = ROOT / "benchmarks" / "arenas"


@pytest.fixture
def arenas(monkeypatch: pytest.MonkeyPatch) -> SimpleNamespace:
    """Stand where the scripts stand: they import each other by their plain names."""
    for folder in (ROOT / "benchmarks", ARENAS):
        monkeypatch.syspath_prepend(str(folder))
    modules = ("run_robot_sf", "robot_sf_arm")
    return SimpleNamespace(**{name: import_module(name) for name in modules})


def row(
    outcome: str, *, what: str = "", start: bool = False, time: float = 10.0
) -> dict[str, Any]:
    return {
        "outcome": outcome,
        "collided_with": what,
        "begins_in_contact": start,
        "time_s": time,
    }


ROWS = {
    "ours": {
        ("door", 1): row("success", time=8.0),
        ("door", 2): row("success"),
        ("door", 3): row("success"),
        ("wall", 1): row("collision", what="person", start=True),
        ("wall", 2): row("timeout"),
    },
    "orca": {
        ("door", 1): row("success", time=9.0),
        ("door", 2): row("collision", what="wall"),
        ("door", 3): row("collision", what="person"),
        ("wall", 1): row("collision", what="person", start=True),
        ("wall", 2): row("success"),
    },
}


def test_ends_of_episodes_are_counted(arenas: SimpleNamespace) -> None:
    ours, orca = arenas.run_robot_sf.counts(ROWS)
    ends = "success", "begin in contact", "hit a wall", "hit a person", "timeout"
    assert [ours[end] for end in ends] == [3, 1, 0, 0, 1]
    assert [orca[end] for end in ends] == [2, 1, 1, 1, 0]
    assert orca["time_s"] == pytest.approx(9.5)


def test_pairs_hold_the_same_cases_alone(arenas: SimpleNamespace) -> None:
    fewer = {**ROWS, "orca": {key: ROWS["orca"][key] for key in list(ROWS["orca"])[:3]}}
    (found,) = arenas.run_robot_sf.pairs(fewer, "ours")
    assert (found["episodes"], found["ours"], found["its"]) == (3, 3, 1)
    assert (found["ours alone"], found["it alone"]) == (2, 0)
    assert found["p"] == pytest.approx(0.5)
    assert found["longer_s"] == pytest.approx(-1.0)
    by_name = {one["scenario"]: one for one in arenas.run_robot_sf.by_scenario(ROWS, "ours")}
    assert by_name["wall"] == {
        "scenario": "wall", "ours": "0 of 2", "orca": "1 of 2", "p, orca": 1.0
    }  # fmt: skip


def test_failures_are_grouped_with_their_seeds(arenas: SimpleNamespace) -> None:
    found = arenas.run_robot_sf.failures(ROWS["orca"])
    assert [(one["how"], one["seeds"]) for one in found] == [
        ("collision person", "3"),
        ("collision wall", "2"),
        ("begins in contact person", "1"),
    ]


def test_rows_come_back_and_shipped_ones_are_compared(
    arenas: SimpleNamespace, tmp_path: Path
) -> None:
    for arm, cases in ROWS.items():
        for (name, seed), one in cases.items():
            case = arenas.run_robot_sf.Case(arm, name, seed)
            own = {"arm": arm, "scenario": name, "seed": seed, **one}
            case.file(tmp_path).parent.mkdir(exist_ok=True)
            write_text(case.file(tmp_path), json.dumps(own))
    read = arenas.run_robot_sf.read(tmp_path, [1, 2])
    assert set(read["ours"]) == {key for key in ROWS["ours"] if key[1] < 3}
    shipped = tmp_path / "rows.csv"
    shipped.write_text(
        "planner_key,scenario_id,seed,success,collision\n"
        "orca,door,1,1.0,0.0\norca,door,2,0.0,1.0\norca,wall,2,0.0,0.0\nppo,door,1,0.0,1.0\n"
    )
    found = arenas.run_robot_sf.agreement(
        read["orca"], arenas.run_robot_sf.shipped_rows(shipped, "orca")
    )
    assert (found["episodes"], found["alike"], found["others"]) == (3, 2, "wall 2")


def test_seeds_are_ranges_or_numbers(arenas: SimpleNamespace) -> None:
    assert arenas.run_robot_sf.seeds_of(["3", "111-113"]) == [3, 111, 112, 113]


def test_a_folder_that_is_no_checkout_is_refused(arenas: SimpleNamespace, tmp_path: Path) -> None:
    words = ["run", "--checkout", str(tmp_path), "--out", str(tmp_path)]
    with pytest.raises(SystemExit, match="wanted robot_sf_ll7"):
        arenas.run_robot_sf.main(words)


class Yard:
    """A made-up arena with the parts of robot_sf that the arm looks at."""

    def __init__(self) -> None:
        limits = SimpleNamespace(
            radius=1.0, max_linear_speed=2.0, max_angular_speed=1.0,
            max_linear_accel=1.0, max_angular_accel=1.0,
        )  # fmt: skip
        walls = shapely.box(0, 0, 24, 1), shapely.box(0, 9, 24, 10)
        obstacles = [SimpleNamespace(iter_polygons=lambda one=one: [one]) for one in walls]
        self.simulator = SimpleNamespace(
            robots=[SimpleNamespace(config=limits)], map_def=SimpleNamespace(obstacles=obstacles)
        )
        self.walls = walls
        self.state = np.array([3.0, 5.0, np.pi, 0.0, 0.0])  # with its back to the goal
        self.people = np.array([[21.0, 5.0], [15.0, 2.5]])
        self.velocities = np.array([[-1.0, 0.0], [0.0, 0.2]])

    def seen(self) -> dict[str, np.ndarray]:
        x, y, phi, v, omega = self.state
        order = np.argsort(np.hypot(*(self.people - (x, y)).T))
        turn = np.array([[np.cos(phi), -np.sin(phi)], [np.sin(phi), np.cos(phi)]])
        room = np.zeros((4, 2), dtype=np.float32)
        places, moving = room.copy(), room.copy()
        places[:2], moving[:2] = self.people[order], self.velocities[order] @ turn
        route = room.copy()
        route[:3] = (x, y), (12.0, 5.0), (21.0, 5.0)
        return {
            "robot_position": np.array([x, y]),
            "robot_heading": np.array([phi]),
            "robot_speed": np.array([v, omega]),
            "pedestrians_positions": places,
            "pedestrians_velocities": moving,
            "pedestrians_count": np.array([2.0]),
            "pedestrians_radius": np.array([0.4]),
            "route_waypoints": route,
        }

    def step(self, action: np.ndarray) -> None:
        """Move on as robot_sf does: accelerations, and never backwards."""
        x, y, phi, v, omega = self.state
        a, alpha = np.clip(action, -1.0, 1.0)
        faster, turning = np.clip(v + 0.1 * a, 0.0, 2.0), np.clip(omega + 0.1 * alpha, -1.0, 1.0)
        turned = phi + 0.05 * (omega + turning)
        way, middle = 0.05 * (v + faster), 0.5 * (phi + turned)
        self.state[:] = x + way * np.cos(middle), y + way * np.sin(middle), turned, faster, turning
        self.people = self.people + 0.1 * self.velocities

    def clear(self) -> float:
        """Return the least distance of the robot's body from people and walls, m."""
        place = shapely.Point(self.state[:2])
        to_people = np.hypot(*(self.people - self.state[:2]).T).min() - 0.4
        return float(min(to_people, *(shapely.distance(wall, place) for wall in self.walls)) - 1.0)


def test_the_arm_turns_around_passes_people_and_arrives(arenas: SimpleNamespace) -> None:
    yard, arm = Yard(), arenas.robot_sf_arm.Arm.of(str(ARENAS / "robot_sf.yaml"))
    arm.enter(yard)
    for _ in range(260):
        yard.step(arm.act(yard.seen()))
        assert yard.clear() > 0.0, arm.now
        if np.hypot(*(yard.state[:2] - (21.0, 5.0))) < 2.0:
            break
    else:
        raise AssertionError(f"it is at {yard.state}")
    found = arm.row()
    assert found["rungs"]["optimal"] >= 0.9 * sum(found["rungs"].values())
    assert found["decision_ms_most"] >= found["decision_ms"] > 0.0


def test_the_page_says_what_the_rows_say(arenas: SimpleNamespace) -> None:
    """Counts of each arm, as the page's table has them."""
    with (ARENAS / "robot_sf_rows.csv").open(newline="") as lines:
        rows = list(csv.DictReader(lines))
    page = (ROOT / "docs" / "arenas.md").read_text()
    for arm, name in {"wideberth": "**wideberth**", "orca": "`orca`"}.items():
        cases = {
            (one["scenario"], int(one["seed"])): {
                **one,
                "begins_in_contact": one["begins_in_contact"] == "True",
                "time_s": 0.1 * int(one["steps"]),
            }
            for one in rows
            if one["arm"] == arm
        }
        (found,) = arenas.run_robot_sf.counts({arm: cases})
        ends = "success", "share", "begin in contact", "hit a wall", "hit a person", "timeout"
        cells = [name, "1440", *(str(found[end]) for end in ends)]
        assert f"| {' | '.join(cells)} |" in page
