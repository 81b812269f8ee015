"""What knowing the future would be worth to one decision: one plan against a thousand futures."""

import io
from collections.abc import Sequence
from dataclasses import dataclass, field, replace
from pathlib import Path
from time import perf_counter
from typing import Any, ClassVar, Self, final

import numpy as np

from ...framework import Controller, Observation, Robot, WideberthError
from ...framework import Path as Way
from ...framework.controller import fresh
from ...framework.mpc.ocp.reference import Reference
from ...framework.mpc.ocp.transcription import Guess
from ...framework.mpc.planner.cycle import Decision, PlannerState, Services, remember, step
from ...framework.mpc.planner.instance import Instance
from ...framework.mpc.planner.starts import at_target, other_starts
from ...framework.mpc.slots.gaussian_discs import GaussianDiscs, KnownDiscs, ObstacleSet, fill
from ...framework.mpc.solver import Solution, Solver, solve_many
from ...framework.plugins.io import read_arrays
from ...framework.values.arrays import Array, BoolArray, positive, whole
from ...framework.values.plan import Status
from ...metrics.statistics import clopper_pearson
from ...simulation.engine.settings import Settings
from ...simulation.scenarios.base import Scenario
from ..drawing.plotting import COLOURS, PAGE, style, subplots, title
from ..engine.closed_loop import check_starts, column, group, inputs_of, pick
from .grid import Axes, GridStudy, Pictures, Result, Row, Task, TaskOutcome, reduced
from .variants import planner_of

SAME = 1e-6
"""Plans whose costs differ by less, relative to the cost, are equally good."""
ENTERED = 1e-5
"""Slack, unit-free, from which on a region counts as entered; a solver leaves less."""
STARTS = ("along", "left", "right", "wait")
"""Of the solves for known futures beside the one plan, see `PlannerSettings.starts`."""
SHOWN = 60
"""Futures that the figure draws."""
COLUMNS = (
    "planner", "instant_s", "tail_held", "cost", "cost_known", "worth", "solved", "touched",
    "touched_low", "touched_high", "speed_spread_mps", "remark",
)  # fmt: skip


@final
@dataclass(frozen=True, eq=False)
class Futures:
    """A decision, and futures drawn from the forecast behind it.

    Attributes
    ----------
    check : the problem of the decision, with the regions around the forecast.
    place, kind, margin : which of its kinds of slots are the forecast's obstacles, and m.
    names, radius : of the obstacles that the problem has room for, (O,), m.
    draws : their positions at steps 1..N, (K, O, N, D), m.
    """

    check: Instance
    place: int
    kind: GaussianDiscs
    margin: float
    names: tuple[str, ...]
    radius: Array
    draws: Array

    @classmethod
    def of(cls, decision: Decision, rng: np.random.Generator, count: int) -> "Futures":
        """Draw futures: the mode by its weight, all steps of an obstacle together.

        Raises
        ------
        WideberthError : the decision solved no problem, or its forecast has no joint covariance.
        """
        plan, solved = decision.plan, decision.solved
        if solved is None or plan.forecast is None:
            raise WideberthError(f"no plan was made among obstacles: {plan.reason or 'none seen'}")
        if plan.forecast.joint is None:
            raise WideberthError(
                "the forecast does not say how its steps belong together: take a predictor with "
                "a joint covariance, such as kalman, and leave planner.track_dt equal to "
                "planner.dt, planner.latency, channel.delay and channel.jitter 0"
            )
        for place, (kind, own) in enumerate(
            zip(solved.instance.around.kinds, solved.instance.around.chosen, strict=True)
        ):
            if own.names and isinstance(kind, GaussianDiscs) and isinstance(own.known, KnownDiscs):
                radius = dict(zip(own.names, own.known.obstacles.radius.tolist(), strict=True))
                rows = [plan.tracked.index(name) for name in radius]
                draws = plan.forecast.sample(rng, count)[:, rows]
                bodies = np.array(list(radius.values()))
                names = tuple(radius)
                return cls(solved.instance, place, kind, own.known.margin, names, bodies, draws)
        raise WideberthError(
            "the problem holds none of the forecast obstacles: raise most_obstacles"
        )

    def obstacles(self, k: int) -> ObstacleSet:
        """Return the obstacles of one future, whose places are known."""
        mean = self.draws[k].swapaxes(0, 1)
        return ObstacleSet(mean, np.zeros((*mean.shape, mean.shape[-1])), self.radius, self.names)

    def known(self, k: int) -> Instance:
        """Return the same problem with the regions of one known future."""
        check, given = self.check, self.check.parameters
        laid = Reference(given.reference, given.direction, given.speed, given.curve)
        radius = self.kind.bodies(check.robot)[0].radius + self.margin
        region, room = self.kind.region, check.problem.slots[self.place].count
        slots = list(given.slots)
        slots[self.place] = fill(laid, self.obstacles(k), region, check.level, radius, room)
        return replace(check, parameters=replace(given, slots=tuple(slots)))

    def solve(
        self, solver: Solver, point: Guess, starts: Sequence[str]
    ) -> tuple[Solution, list[list[Solution]]]:
        """Return the one plan, and of each future the plans from every start, in one call.

        ``point`` is where the one plan is solved from, and the first start of every future.
        """
        check, given = self.check, self.check.parameters
        ways = [point, *other_starts(check.robot, check.problem, given, point, starts)]
        parameters, guesses = [given], [point]
        for k in range(len(self.draws)):
            known = self.known(k)
            found = [at_target(known, one.states, one.inputs) for one in ways]
            guesses += found
            parameters += [one.pull(known.parameters) for one in found]
        one, *rest = solve_many(solver, check.problem, parameters, guesses)
        return one, [rest[i : i + len(ways)] for i in range(0, len(rest), len(ways))]

    def touched(self, states: Array) -> BoolArray:
        """Whether a plan's bodies touch an obstacle's at steps 1..N of each future, (K, N)."""
        discs = (KnownDiscs(self.kind, self.obstacles(k), 0.0) for k in range(len(self.draws)))
        return np.array([one.overlap(self.check.robot, states) > 0.0 for one in discs])

    def tail(self, point: Guess) -> float:
        """Return the largest tail that a plan holds, of one obstacle at one step."""
        check, levels = self.check, self.check.parameters.slots[self.place].level
        level = point.level if levels is None or check.problem.shared else float(levels.min())
        return self.kind.tail(level, check.level.promise, check.robot.dimension)


@final
@dataclass(frozen=True)
class KnownFutures(GridStudy):
    """One plan that keeps clear of a forecast's regions, against plans for known futures.

    At some instants of an episode every planner makes one plan, of cost J, from what its robot
    has seen ("here and now"). Whole futures of the obstacles are drawn from the forecast behind
    it, and the same problem is solved for each with the drawn positions in place of the means and
    no covariance, at cost J_k ("wait and see"). The expected value of perfect information is::

        worth = J - (1 / K) sum_k J_k

    Costs are objectives of the MPC, prices of slack and of the level included, and the best of
    several starts: J_k is a local optimum, as J is. A region asks for more than uncertainty alone
    would, so that ``worth`` is also what caution costs. ``touched`` is the share of futures in
    which a robot that drives the one plan to its end, and never plans again, touches a body at
    any step (95 % interval by Clopper and Pearson). The plan's promise, ``tail_held``, is for one
    step and obstacle: ``touched_worst_step`` is the largest share at one step. ``entered`` is
    the share of futures in which no plan keeps the margin; ``speed_spread_mps`` and
    ``turn_spread_radps`` are standard deviations of the first command over the futures.

    Parameters
    ----------
    scenario, robot, seed, settings : the episode. Its first robot is examined, and its planners
        know what it has seen from time 0 on.
    planners : by name. The first drives all robots up to the instants.
    instants : s; the first decision from then on is examined.
    solver : of all problems; one that solves many at once is the quickest.
    draws : K.
    shown_instant : the place among the instants whose futures and first plans are drawn.
    """

    claim: ClassVar[str] = (
        "A plan that keeps clear of regions pays for not knowing the future: what would it be "
        "worth to one decision to know it, and is the promise kept in the futures forecast?"
    )
    reference: ClassVar[str] = "birge2011introduction,schoeneberg2025trajectory"
    printed: ClassVar[tuple[str, ...]] = (
        *("tail_held", "cost", "cost_known", "worth"),
        *("solved", "touched", "speed_spread_mps", "remark"),
    )

    scenario: Scenario
    robot: Robot
    planners: dict[str, Controller]
    instants: tuple[float, ...]
    solver: Solver
    draws: int = 1000
    shown_instant: int = 0
    seed: int = 0
    settings: Settings = field(default_factory=Settings)

    def __post_init__(self) -> None:
        whole("draws", self.draws)
        whole("seed", self.seed, least=0)
        if not self.planners or not self.instants:
            raise WideberthError("planners and instants must each name at least one")
        for instant in self.instants:
            positive("instants", instant, zero=True)
        if len(set(self.instants)) < len(self.instants):
            raise WideberthError(f"instants is {self.instants}; wanted each of them once")
        if not 0 <= self.shown_instant < len(self.instants):
            raise WideberthError(
                f"shown_instant is {self.shown_instant}; wanted the place of one of "
                f"{len(self.instants)} instants, counted from 0"
            )
        for controller in self.planners.values():
            planner_of(controller)
        if not self.settings.localisation.exact:
            raise WideberthError(
                "settings.localisation is not exact; known futures are those of the obstacles "
                "alone: leave it out"
            )

    def axes(self) -> Axes:
        """Each planner at each instant."""
        return {
            "planner": self.planners,
            "instant": range(len(self.instants)),
            "seed": [self.seed],
        }

    def inputs(self) -> list[Path]:
        """Return the files that the scenario reads."""
        return inputs_of([self.scenario])

    def check(self) -> None:
        """Drive to the last instant, and draw a future of every planner's forecast there."""
        check_starts({"": self.scenario}, self.robot, self.planners, self.seed)
        way, seen = self.watched(max(self.instants))
        for name in self.planners:
            Futures.of(self.decide(name, way, seen), np.random.default_rng(0), 1)

    def watched(self, instant: float) -> tuple[Way, list[Observation]]:
        """Return the path of the first robot and what it observes, up to its decision.

        Raises
        ------
        WideberthError : the episode ends before.
        """
        driver, cast = next(iter(self.planners.values())), self.scenario.cast(self.seed)
        robots = [one.agent(self.robot, fresh(driver), True) for one in cast.placements]
        run = cast.begin(robots, self.settings, self.seed)
        seen: list[Observation] = []
        while not seen or seen[-1].stamp < instant:
            observation = run.advance(robots[0].name)
            if observation is None:
                raise WideberthError(
                    f"the episode ended at {run.clock[-1]:g} s ({run.ended}), and instants holds "
                    f"{instant:g} s: take earlier ones"
                )
            seen.append(observation)
        return robots[0].path, seen

    def decide(self, name: str, way: Way, seen: Sequence[Observation]) -> Decision:
        """Decide from the last observation, all others remembered.

        Obstacles that no plan can meet by their regions take part too: their futures may come
        nearer.
        """
        planner = planner_of(self.planners[name])
        state = PlannerState.initial(planner, way)
        for one in seen[:-1]:
            state = remember(planner, state, one)
        return step(planner, state, seen[-1], Services.of(planner).for_all())[1]

    def measure(self, task: Task) -> TaskOutcome:
        """Make the one plan, and those of all drawn futures."""
        name, i = str(task.settings["planner"]), int(task.settings["instant"])
        decision = self.decide(name, *self.watched(self.instants[i]))
        rng = np.random.default_rng([task.seed, i])  # planners that forecast alike draw alike
        futures, solved = Futures.of(decision, rng, self.draws), decision.solved
        assert solved is not None
        begin = perf_counter()
        one, found = futures.solve(self.solver, solved.point, STARTS)
        labels: Row = {"planner": name, "instant_s": round(decision.plan.stamp, 3)}
        solves = 1 + sum(len(some) for some in found)
        times: list[Row] = [{**labels, "solves": solves, "solve_s": perf_counter() - begin}]
        best = [_best(some) for some in found]
        row = labels | measured(futures, one, best)
        if name != next(iter(self.planners)) or i != self.shown_instant:
            return TaskOutcome([row], times)
        return TaskOutcome([row], times, {"futures.npz": _content(futures, one, best)})

    def summary(self, rows: list[Row]) -> list[Row]:
        """One line per planner and instant."""
        return [pick(row, COLUMNS) for row in rows]

    def pictures(self, result: Result) -> Pictures:
        """Draw futures and plans of one decision, the costs, and the promise."""
        yield (
            "known_futures",
            draw(result.rows, read_arrays(result.read("futures.npz"), "futures.npz")),
        )

    def quick(self) -> Self:
        """Keep the first planner, one instant and a few futures."""
        instants = (self.instants[self.shown_instant],)
        return reduced(replace(self, instants=instants, shown_instant=0), planners=1, draws=10)


def _best(solutions: Sequence[Solution]) -> Solution | None:
    """Return the cheapest that is solved, of equally cheap ones the first; None without any."""
    solved = [one for one in solutions if one.status is Status.SOLVED]
    least = min((one.cost for one in solved), default=np.inf)
    return next((one for one in solved if one.cost <= least + SAME * (1.0 + abs(least))), None)


def measured(futures: Futures, one: Solution, best: Sequence[Solution | None]) -> Row:
    """Compare the one plan with the best plan of each future, None where none was solved."""
    known = [own for own in best if own is not None]
    failed = one.status is not Status.SOLVED
    cost = np.nan if failed else one.cost
    costs = np.array([own.cost for own in known] or [np.nan])
    slack = np.array([own.point.slack.max(initial=0.0) for own in known] or [np.nan])
    low, middle, high = np.percentile(costs, (5.0, 50.0, 95.0))
    touched = futures.touched(one.point.states)
    hit, count = int(touched.any(axis=1).sum()), len(best)
    interval = clopper_pearson(hit, count)
    speed, turn = _spread(futures.check.robot, [own.point for own in known])
    return {
        "tail": futures.check.level.tail,
        "tail_held": _digits(futures.tail(one.point)),
        "entered_steps": int((one.point.slack > ENTERED).sum()),
        "obstacles": len(futures.names),
        "draws": count,
        "solved": len(known) / count,
        "cost": _digits(cost),
        "cost_known": _digits(costs.mean()),
        "cost_known_q05": _digits(low),
        "cost_known_median": _digits(middle),
        "cost_known_q95": _digits(high),
        "worth": _digits(cost - costs.mean(), SAME * abs(cost)),
        "touched": hit / count,
        "touched_low": _digits(interval[0]),
        "touched_high": _digits(interval[1]),
        "touched_worst_step": float(touched.mean(axis=0).max()),
        "entered": float((slack > ENTERED).mean()),
        "speed_spread_mps": speed,
        "turn_spread_radps": turn,
        "remark": f"the one plan: {one.message}" if failed else "",
    }


def _spread(robot: Robot, points: Sequence[Guess]) -> tuple[float, float]:
    """Return standard deviations of the first command, m/s and rad/s."""
    twists = [robot.twist(tuple(one.states[1]), tuple(one.inputs[0])) for one in points]
    linear = np.array([one.linear for one in twists] or [(np.nan,)], dtype=np.float64)
    turning = np.array([one.angular for one in twists] or [np.nan], dtype=np.float64)
    return round(float(np.sqrt(linear.var(axis=0).sum())), 3), round(float(turning.std()), 3)


def _digits(value: float, least: float = 0.0) -> float:
    """Round to four digits, which the width of a batch does not change; to 0 up to the least."""
    return 0.0 if abs(value) <= least else float(f"{value:.4g}")


def _content(futures: Futures, one: Solution, best: Sequence[Solution | None]) -> bytes:
    """Return what is drawn, m, to the centimetre."""
    robot = futures.check.robot
    points = [one.point, *(own.point for own in best[:SHOWN] if own is not None)]
    ways = [np.stack(robot.pose(tuple(own.states.T)).position, axis=-1) for own in points]
    draws, buffer = futures.draws[:SHOWN].reshape(-1, *futures.draws.shape[2:]), io.BytesIO()
    np.savez_compressed(buffer, draws=np.round(draws, 2), plans=np.round(np.array(ways), 2) + 0.0)
    return buffer.getvalue()


MARKERS = "osD^v"
"""One per planner; every other one is hollow."""


def draw(rows: Sequence[Row], shown: dict[str, Array]) -> Any:
    """Draw futures and plans of one decision, the costs over the instants, and the promise."""
    figure, (ways, costs, shares) = subplots(1, 3, figsize=(PAGE, 3.0))
    _draw_ways(ways, shown)
    for i, ((name,), some) in enumerate(group(rows, "planner").items()):
        look: dict[str, Any] = {
            **style(i, MARKERS), "markersize": 4.0, "markerfacecolor": "white" if i % 2 else None,
        }  # fmt: skip
        instants, touched = column(some, "instant_s"), column(some, "touched")
        if i == 0:  # those of the others differ as far as their forecasts do
            ends = column(some, "cost_known_q05"), column(some, "cost_known_q95")
            label = "futures known: 5 to 95 %, mean"
            costs.vlines(instants, *ends, color="0.8", linewidth=7.0, label=label)
            known = {"marker": "_", "markersize": 8.0, "color": "0.4"}
            costs.plot(instants, column(some, "cost_known"), linewidth=0.0, **known)
        costs.plot(instants, column(some, "cost"), **look)
        reach = touched - column(some, "touched_low"), column(some, "touched_high") - touched
        look |= {"linestyle": "", "elinewidth": 0.7, "capsize": 1.5, "label": title(str(name))}
        shares.errorbar(column(some, "tail_held"), touched, yerr=np.abs(reach), **look)
    costs.set(xlabel="instant (s)", ylabel="cost of the plan (objective)", yscale="log")
    line = {"color": "black", "linestyle": ":", "linewidth": 0.9, "label": "share = tail"}
    shares.axline((0.0, 0.0), (1.0, 1.0), **line)
    shares.set_xscale("symlog", linthresh=0.01)  # shares may be 0
    shares.set_yscale("symlog", linthresh=0.01)
    shares.set(xlabel="tail held at each step", ylabel="share of futures touched")
    shares.set(xlim=(0.0, 1.4), ylim=(0.0, 1.4))
    figure.legend(loc="outside lower center", ncols=5)
    return figure


def _draw_ways(panel: Any, shown: dict[str, Array]) -> None:
    """Draw drawn futures, the plans that know them, and the one plan, from above."""
    for k, way in enumerate(shown["draws"]):
        label = "" if k else "drawn futures of the other"
        panel.plot(*way.T[:2], "-", color="0.65", linewidth=0.5, label=label)
    for k, way in enumerate(shown["plans"][1:]):
        label = "" if k else "plans, each for its future"
        panel.plot(*way.T[:2], "--", color=COLOURS[1], linewidth=0.5, label=label)
    panel.plot(*shown["plans"][0].T[:2], "-", color="black", linewidth=2.0, label="the one plan")
    panel.plot(*shown["plans"][0, 0, :2], "ko", markersize=5.0)
    panel.set(xlabel="x (m)", ylabel="y (m)", aspect="equal", adjustable="datalim")
