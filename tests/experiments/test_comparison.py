"""Comparing controllers: pairs, shares, figures, and what is refused."""

from dataclasses import dataclass, field, replace
from pathlib import Path as File
from typing import Any, final

import numpy as np
import pytest

from wideberth.controllers.withdrawing import Withdrawing
from wideberth.experiments.engine.base import Row
from wideberth.experiments.engine.column_descriptions import column_texts
from wideberth.experiments.engine.runner import draw, run
from wideberth.experiments.engine.shipped_configs import read_experiment
from wideberth.experiments.studies.agility import AGILITY, agile
from wideberth.experiments.studies.comparison import Comparison
from wideberth.experiments.studies.comparison_figures import _pairs, draw_front
from wideberth.experiments.studies.episode_statistics import (
    against,
    condensed,
    means,
    promised,
)
from wideberth.framework.controller import Controller, DrivesRobot, driving
from wideberth.framework.robot import Robot
from wideberth.framework.values.errors import WideberthError
from wideberth.framework.values.motion import Command, Observation
from wideberth.framework.values.path import Path
from wideberth.framework.values.plan import Plan
from wideberth.metrics.statistics import signed_rank
from wideberth.robots.holonomic_velocity import HolonomicVelocity
from wideberth.robots.unicycle import Unicycle
from wideberth.simulation.engine.agents import ScriptedAgent
from wideberth.simulation.engine.settings import Settings
from wideberth.simulation.log.episode_log import Episode
from wideberth.simulation.scenarios.base import Placement, Scenario
from wideberth.simulation.scenarios.doorway import Doorway

SLOW, FAST = 0.5, 1.0


@final
@dataclass(eq=False)
class Straight(Controller):
    """Goes east at one speed, whatever is there."""

    speed: float = SLOW
    robot: Robot = field(default_factory=lambda: HolonomicVelocity(0.3, 1.0))
    period: float = 0.25

    def reset(self) -> None:
        """Nothing is kept."""

    def set_path(self, path: Path) -> None:
        """Goes east all the same."""

    def remember(self, observation: Observation) -> None:
        """Nothing is kept."""

    def command(self, observation: Observation) -> Command:
        """Go east."""
        return Command((self.speed, 0.0))

    @property
    def last_plan(self) -> Plan | None:
        """None."""
        return None


@final
@dataclass(frozen=True)
class Gate(Scenario):
    """5 m east; from the third seed on somebody stands in the way."""

    def cast(self, seed: int) -> Any:
        """Draw nothing."""
        made = super().cast(seed)
        return made if seed >= 2 else replace(made, bystanders=())

    def build(self, rng: np.random.Generator) -> tuple[Placement, ...]:
        """One robot."""
        return (Placement("robot", Path(np.array([[0.0, 0.0], [5.0, 0.0]])), 0.5),)

    def bystanders(
        self, rng: np.random.Generator, placements: tuple[Placement, ...]
    ) -> tuple[ScriptedAgent, ...]:
        """One who stands."""
        stands = Path(np.array([[2.5, 0.0], [2.5, 1.0]]))
        return (ScriptedAgent("post", stands, 0.0, 0.2),)

    def judge(self, episode: Episode) -> dict[str, Any]:
        """By rules of its own."""
        return {"late": episode.duration > 6.0, "word": episode.ended}


@pytest.fixture(scope="module")
def gate() -> Comparison:
    return Comparison(
        scenarios={"gate": Gate()},
        robots={"disc": HolonomicVelocity(0.3, 1.0)},
        controllers={"slow": Straight(SLOW), "fast": Straight(FAST)},
        settings={"plain": Settings(time_limit=30.0, plant_step=0.25, goal_tolerance=0.3)},
        seeds=4,
    )


@pytest.fixture(scope="module")
def rows(gate: Comparison) -> list[Row]:
    return [row for task in gate.tasks() for row in gate.measure(task).rows]


def test_times_say_which_model_was_driven(gate: Comparison) -> None:
    """The label ``robot`` is the model; who drove it is the ``agent``."""
    task = gate.tasks()[0]
    (row,) = gate.measure(task).times
    assert (row["robot"], row["agent"]) == (task.settings["robot"], "robot")


def test_what_was_played(gate: Comparison, rows: list[Row]) -> None:
    assert len(rows) == len(gate.tasks()) == 8
    assert [row["outcome"] for row in rows[:4]] == ["success"] * 2 + ["collision"] * 2
    # 4.7 m at 0.5 and 1 m/s, seen at steps of 0.25 s.
    assert rows[0]["success_time"] == 9.5 and rows[4]["success_time"] == 4.75
    assert np.isnan(rows[2]["success_time"]) and rows[2]["penalised_time"] == 30.0
    assert rows[0]["speed_mean"] == pytest.approx(0.5)
    assert rows[0]["distance_min"] == np.inf and np.isnan(rows[0]["distance_mean"])
    assert rows[0]["zone_public"] == 1.0 and rows[0]["social_work"] == 0.0
    assert rows[2]["distance_min"] == pytest.approx(-0.5)
    assert (rows[2]["contacts_by_robot"], rows[2]["contacts_by_other"]) == (1, 0)
    assert rows[2]["time_to_collision_min"] == 0.0
    # Nearer than 0.2 m along 2 (0.5 + 0.2) m of the way, at 0.25 s and 0.125 m a step: 11 of 39.
    assert rows[2]["intrusion_share"] == pytest.approx(11 / 39)
    assert rows[0]["jerk_rms"] == pytest.approx(0.0, abs=1e-9)
    assert rows[0]["heading_change"] == 0.0 and not rows[0]["frozen"]
    assert np.isnan(rows[0]["plan_change"]) and np.isnan(rows[0]["step_risk"])


def test_lines_are_paired_with_the_baseline(gate: Comparison, rows: list[Row]) -> None:
    slow, fast = gate.summary(rows)
    assert list(slow)[:2] == ["controller", "episodes"]  # one scenario, robot and settings
    for line in (slow, fast):
        assert line["success"] == line["collision"] == 0.5
        assert line["success_low"] == pytest.approx(0.0676, abs=1e-4)
        assert line["only_this"] == line["only_baseline"] == 0
        # Two seeds at which both arrive are too few for an interval, as in the figures.
        assert np.isnan([line["time_difference_low_s"], line["time_difference_high_s"]]).all()
    assert np.isnan([slow["time_difference_s"], slow["p_success"]]).all()  # the baseline itself
    assert (fast["time_difference_s"], fast["p_success"]) == (-4.75, 1.0)
    assert slow["time_mean_s"] == 9.5 and slow["time_penalised_s"] == 0.5 * (9.5 + 30.0)
    assert slow["judged_late"] == 1.0 and fast["judged_late"] == 0.0
    assert slow["judged_word"] == "goals 4"
    other = replace(gate, baseline="fast", oracle="fast").summary(rows)
    for name in ("time_difference_s", "price_of_uncertainty_s"):
        assert other[0][name] == 4.75 and np.isnan(other[1][name])


def test_pairs_are_of_one_seed() -> None:
    """Shuffled rows, and a seed that only one of them played."""
    first = [
        {"seed": seed, "success": seed != 3, "success_time": 10.0 + seed} for seed in (4, 1, 3, 2)
    ]
    second = [{"seed": seed, "success": True, "success_time": 10.0} for seed in (1, 2, 3, 9)]
    found = against(first, second)
    assert (found["only_this"], found["only_baseline"]) == (0, 1)
    assert found["time_difference_s"] == 2.0
    assert found["p_time"] == 0.25  # of the differences 1, 2 and 3 s


def test_the_chance_of_a_difference_of_times() -> None:
    """Of n differences of one sign the exact p value is 2 / 2^n."""
    for n in (3, 6, 9):
        assert signed_rank(np.arange(1.0, n + 1.0)) == pytest.approx(2.0 / 2**n)
    assert signed_rank(np.array([np.nan, 0.0, 1.0, 2.0, 3.0])) == pytest.approx(0.25)
    assert signed_rank(np.zeros(3)) == 1.0 and np.isnan(signed_rank(np.array([np.nan])))


@pytest.mark.parametrize(("seeds", "known"), [(9, False), (10, True)])
def test_the_table_has_an_interval_from_as_many_pairs_on_as_the_figure(
    seeds: int, known: bool
) -> None:
    first, second = (
        [{"seed": i, "success": True, "success_time": base + i % 2 * jump} for i in range(seeds)]
        for base, jump in ((10.0, 1.0), (9.0, 0.0))
    )
    found = against(first, second)
    ends = [found["time_difference_low_s"], found["time_difference_high_s"]]
    assert found["time_difference_s"] == pytest.approx(1.0 + (seeds // 2) / seeds)
    assert 1.0 < ends[0] < ends[1] < 2.0 if known else np.isnan(ends).all()


def test_promises_are_held_against_what_happened(rows: list[Row]) -> None:
    made = [
        {**rows[0], "tail_nominal": 0.1, "tail_observed": share, "episode_touched": float(i > 1)}
        for i, share in enumerate((0.0, 0.1, 0.2, 0.1))
    ]
    line = promised(made)
    assert line["tail_nominal"] == pytest.approx(0.1) == line["tail_observed"]
    assert line["tail_observed_low"] < 0.1 < line["tail_observed_high"]
    assert line["episode_touched"] == 0.5
    assert line["episode_touched_low"] == pytest.approx(0.0676, abs=1e-4)
    assert np.isnan(promised(rows)["step_risk"])


def test_every_number_has_its_mean(rows: list[Row]) -> None:
    found = means(rows[:2])
    assert found["success_time"] == 9.5 and found["deadlock"] == 0.0
    assert not {"seed", "outcome", "judged_word"} & set(found)
    assert condensed(rows[:2])["success"] == 1.0


def test_first_contacts_are_counted_by_kind_and_described(rows: list[Row]) -> None:
    """At two of four seeds a post stands in the way of both, which never turned nor came."""
    own = [row for row in rows if row["controller"] == "fast"]
    assert [row["contact_kind"] for row in own] == ["", "", "other", "other"]
    assert [row["contact_with"] for row in own] == ["", "", "post", "post"]
    assert (
        condensed(own)["contact_kinds"] == "other 2" and condensed(own[:2])["contact_kinds"] == ""
    )
    assert own[2]["avoidable_2s"] is True and np.isnan(own[0]["avoidable_2s"])
    beginnings = ("contact_", "avoidable_", "level_held_", "forecast_", "plan_")
    names = [name for name in (*own[0], *condensed(own)) if name.startswith(beginnings)]
    assert len(names) > 50 and set(names) <= set(column_texts("comparison"))


def test_a_controller_gets_the_robot_that_it_drives(gate: Comparison) -> None:
    own, other = HolonomicVelocity(0.3, 1.0), Unicycle()
    controller = Straight(SLOW, own)
    assert driving(controller, own) is controller
    changed = driving(controller, other)
    assert isinstance(changed, Straight) and changed.robot == other and changed.speed == SLOW
    wrapped = driving(Withdrawing(Straight(SLOW, own)), other)
    assert wrapped.robot == other and wrapped.controller.robot == other
    assert driving(wrapped, other) is wrapped
    both = replace(gate, robots={"disc": own, "unicycle": other})
    assert len(both.tasks()) == 16


def test_agility_is_a_row_of_its_own(gate: Comparison) -> None:
    """From 0.5 to 1 m/s a robot with the acceleration a loses (0.5 m/s)^2 / (2 a 1 m/s) s."""
    robot = Unicycle(0.3, max_speed=1.0)
    study = replace(
        gate,
        robots={"wheels": robot},
        controllers={"fast": Straight(FAST, robot)},
        settings={"fine": Settings(plant_step=0.01, goal_tolerance=0.3)},
        agility=("shipped", "person"),
        seeds=1,
    )
    rows = [row for task in study.tasks() for row in study.measure(task).rows]
    assert [row["robot"] for row in rows] == ["wheels shipped", "wheels person"]
    slow, quick = (row["success_time"] for row in rows)
    assert slow - quick == pytest.approx(0.125 / 0.7 - 0.125 / 3.0, abs=0.015)
    assert [line["robot"] for line in study.summary(rows)] == ["wheels shipped", "wheels person"]
    assert study.quick().agility == ("shipped",)


@pytest.mark.parametrize(
    "name", ["random_crowd", "hallway", "crowdnav_kinodynamic", "pedestrian_corridor"]
)
def test_crowds_can_be_met_by_other_robots(name: str) -> None:
    """With another agility the robot keeps its size and its speed, and all controllers take it."""
    study, _ = read_experiment(name, ["agility=[shipped, service, person]"])
    assert isinstance(study, Comparison)
    (own,) = study.robots.values()
    places = len(study.scenarios) * len(study.controllers) * study.seeds
    assert len(study.tasks()) == 3 * places
    for word, limits in AGILITY.items():
        found = agile(own, word, "")
        assert all(getattr(found, key) == value for key, value in limits.items())
        assert (found.radius, found.max_speed) == (own.radius, own.max_speed)
        assert (found == own) is (name == "random_crowd" and word == "shipped")


def test_a_limit_that_is_set_reaches_all_who_name_the_robot() -> None:
    """Controllers name the robot by an alias, so that one override is enough."""
    study, _ = read_experiment("random_crowd", ["robots.unicycle.max_acceleration=3.0"])
    assert isinstance(study, Comparison)
    driven: list[Any] = [*study.robots.values()]
    driven += [one.robot for one in study.controllers.values() if isinstance(one, DrivesRobot)]
    assert [one.max_acceleration for one in driven] == [3.0] * (1 + len(study.controllers))


def test_an_agility_that_does_not_fit_is_refused(gate: Comparison) -> None:
    with pytest.raises(WideberthError, match=r"agility: .*'persn'.*person"):
        replace(gate, agility=("persn",))
    lacking = "max_acceleration, max_yaw_acceleration, max_yaw_rate"
    with pytest.raises(
        WideberthError, match=f"robots.disc is a HolonomicVelocity without {lacking}"
    ):
        replace(gate, agility=("person",))


def test_what_makes_no_comparison_is_refused(gate: Comparison) -> None:
    with pytest.raises(
        WideberthError, match=r"controllers.slow drives .*, unlike robots.unicycle: "
    ):
        replace(gate, robots={"unicycle": Unicycle()})
    for name in ("scenarios", "robots", "controllers", "settings"):
        with pytest.raises(WideberthError, match=f"{name} is empty"):
            replace(gate, **{name: {}})
    with pytest.raises(WideberthError, match="baseline is 'quick'"):
        replace(gate, baseline="quick")
    with pytest.raises(WideberthError, match="oracle is"):
        replace(gate, oracle="none")
    with pytest.raises(WideberthError, match=r"show is \[4\]; wanted seeds in \[0, 4\)"):
        replace(gate, show=(4,))
    with pytest.raises(WideberthError, match="seeds"):
        replace(gate, seeds=0)
    own = next(iter(gate.robots.values()))
    assert replace(gate, scenarios={"door": Doorway(robot_radius=own.radius)}).tasks()
    with pytest.raises(WideberthError, match=r"door has room for .* 0.26 m.*robot_radius"):
        replace(gate, scenarios={"door": Doorway(robot_radius=0.26)})


def test_where_nobody_arrived_the_figures_say_so(gate: Comparison) -> None:
    """No ticks that mean nothing: neither of the front nor of the pairs."""
    from matplotlib import pyplot

    short = {"nominal": Settings(time_limit=1.0)}
    early = replace(gate, settings=short, seeds=1, show=())
    rows = [row for task in early.tasks() for row in early.measure(task).rows]
    names = list(gate.controllers)
    figures = [draw_front(rows, names), _pairs(rows, names, names[0])]
    assert [text.get_text() for text in figures[0].axes[0].texts] == ["no arrivals"]
    assert len(figures[0].axes[0].get_xticks()) == 0
    assert len(figures[1].axes[0].get_xticks()) == 0
    for figure in figures:
        pyplot.close(figure)


def test_seeds_begin_where_they_shall(gate: Comparison) -> None:
    later = replace(gate, first_seed=1000, seeds=2, show=(1001,))
    assert {task.seed for task in later.tasks()} == {1000, 1001}
    assert later.quick().show == () and later.quick().seeds == 1


def test_the_shipped_comparison_runs_and_draws(tmp_path: File) -> None:
    shorter = ["scenarios.crossing_field.walkers=2", "settings.noise_1_cm.time_limit=5.0"]
    shipped, _ = read_experiment("comparison", shorter)
    assert isinstance(shipped, Comparison)
    result = run(shipped, tmp_path / "out", quick=True)
    (first, *_others) = result.rows
    assert 0.0 <= first["step_risk"] < 1.0 and first["region_area"] > 0.0
    assert first["plan_change"] > 0.0
    names = {path.name for path in draw(tmp_path / "out")}
    assert {"outcomes.png", "clearance_against_time.pdf", "paired_times.png", "means.csv"} <= names
    assert sum(name.startswith("run_") and name.endswith(".png") for name in names) == 6
    assert sum(name.endswith(".gif") for name in names) == 1
