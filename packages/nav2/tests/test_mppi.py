"""MPPI beside the recorded cases: plain re-computations of critics, memory, limits, refusals."""

from dataclasses import dataclass, field, replace
from math import atan2, cos, exp, fmod, hypot, log, pi, sin

import numpy as np
import pytest

from wideberth.framework.values.costmap import Costmap
from wideberth.framework.values.errors import WideberthError
from wideberth.packages.nav2.tests import ticks
from wideberth.packages.nav2.tests.ticks import free
from wideberth_nav2.controllers.local_controller import Tick
from wideberth_nav2.controllers.local_controllers import shipped_parameters
from wideberth_nav2.controllers.mppi import CRITICS, MPPI
from wideberth_nav2.controllers.mppi_critics import (
    ConstraintCritic,
    CostCritic,
    GoalCritic,
    MppiCritic,
    ObstaclesCritic,
    PathAlignCritic,
    PathAngleCritic,
    PathFollowCritic,
    TwirlingCritic,
)
from wideberth_nav2.controllers.mppi_rollouts import (
    ControlLimits,
    MppiTick,
    Rollouts,
    delayed,
    driven,
    followed,
)
from wideberth_nav2.costmap.footprint import RobotFootprint

LIMITS = ControlLimits(0.5, -0.35, 1.9, 3.0, -3.0, 3.5, 0.0)
STEPS, BATCH = 56, 40


def tick_of(costmap: Costmap, reach: float = 2.0, points: int = 81, **changes: object) -> Tick:
    """A path that bends to the left."""
    along = np.linspace(0.0, reach, points)
    plan = np.stack([along, 0.15 * along**2, np.arctan(0.3 * along)], axis=1)
    given = {"pose": np.array([0.02, -0.03, 0.1]), "speed": np.array([0.3, 0.0, 0.0]), **changes}
    return ticks.tick(plan, costmap=costmap, **given)


def rolled(seed: int = 0) -> Rollouts:
    rng = np.random.default_rng(seed)
    vx = (0.4 + 0.2 * rng.standard_normal((1, BATCH)) + np.zeros((STEPS, 1))).astype(np.float32)
    wz = (0.3 * rng.standard_normal((1, BATCH)) + np.zeros((STEPS, 1))).astype(np.float32)
    return driven(vx, wz, np.array([0.02, -0.03, 0.1]), 0.05)


def situation_of(tick: Tick, limits: ControlLimits = LIMITS) -> MppiTick:
    return MppiTick(tick, limits, 0.05)


def wrap(angle: float) -> float:
    rest = fmod(angle + pi, 2.0 * pi)
    return rest + pi if rest < 0.0 else rest - pi


def aligned(rollouts: Rollouts, situation: MppiTick, far: int, k: int, yaws: bool) -> float:
    """The mean distance of one trajectory from the path, in a plain loop."""
    path, arc, valid = situation.path, situation.arc, situation.valid
    x, y, yaw = rollouts.x[::4, k], rollouts.y[::4, k], rollouts.yaw[::4, k]
    length, at, total, count = 0.0, 0, 0.0, 0
    for p in range(1, len(x)):
        length += hypot(x[p] - x[p - 1], y[p] - y[p - 1])
        before, found = (arc[at] if at else 0.0), far - 1
        for i in range(at + 1, far):
            if arc[i] > length:
                found = i - 1 if length - before < arc[i] - length else i
                break
            before = arc[i]
        at = found
        if valid[at]:
            turn = wrap(path[2, at] - yaw[p]) if yaws else 0.0
            total += hypot(path[0, at] - x[p], path[1, at] - y[p], turn)
            count += 1
    return total / count if count else 0.0


@pytest.mark.parametrize("yaws", [False, True])
@pytest.mark.parametrize("blocked", [[], [12], [12, 40]])
@pytest.mark.parametrize("points", [61, 81])
def test_alignment_is_that_of_a_plain_loop(blocked: list[int], yaws: bool, points: int) -> None:
    tick = tick_of(free(120), points=points)
    cells = tick.costmap.cells.copy()
    for i in blocked:
        mx, my = tick.costmap.world_to_map(tick.plan[i, :2])
        cells[my, mx] = 253
    tick = replace(tick, costmap=Costmap(cells, 0.05, tick.costmap.origin))
    situation, rollouts = situation_of(tick), rolled()
    far = situation.furthest(rollouts)
    invalid = int((~situation.valid[:far]).sum())
    assert far > 36 and (invalid > 0) == bool(blocked)
    critic = PathAlignCritic(max_path_occupancy_ratio=0.5, use_path_orientations=yaws)
    found = critic.cost(rollouts, situation)
    wanted = [10.0 * aligned(rollouts, situation, far, k, yaws) for k in range(BATCH)]
    assert found == pytest.approx(wanted, rel=1e-4, abs=1e-5)
    strict = PathAlignCritic(max_path_occupancy_ratio=(invalid - 0.5) / far)
    assert (strict.cost(rollouts, situation) is None) == (invalid > 2)
    assert PathAlignCritic(offset_from_furthest=far + 1).cost(rollouts, situation) is None
    assert PathAlignCritic(threshold_to_consider=9.0).cost(rollouts, situation) is None


def test_slow_trajectories_stay_at_a_point_of_the_path() -> None:
    situation = situation_of(tick_of(free(120), points=9))  # 0.25 m apart
    vx = np.linspace(0.02, 0.3, BATCH, dtype=np.float32) + np.zeros((STEPS, 1), np.float32)
    rollouts = driven(vx, 0.1 * vx, np.array([0.02, -0.03, 0.1]), 0.05)
    far = situation.furthest(rollouts)
    found = PathAlignCritic(offset_from_furthest=1).cost(rollouts, situation)
    wanted = [10.0 * aligned(rollouts, situation, far, k, False) for k in range(BATCH)]
    assert far > 2 and found == pytest.approx(wanted, rel=1e-4, abs=1e-5)


def test_the_furthest_point_is_that_of_the_first_question() -> None:
    situation = situation_of(tick_of(free(120)))
    far = situation.furthest(rolled())
    short = driven(*np.zeros((2, STEPS, 3), np.float32), np.array([0.02, -0.03, 0.1]), 0.05)
    assert situation.furthest(short) == far > 0
    assert situation_of(tick_of(free(120))).furthest(short) == 0


def test_a_path_blocked_to_its_end_is_followed_to_the_last_point_but_one() -> None:
    tick, rollouts = tick_of(free(120)), rolled()
    cells = tick.costmap.cells.copy()
    for mx, my in tick.costmap.world_to_map(tick.plan[20:, :2]):
        cells[my, mx] = 254
    situation = situation_of(replace(tick, costmap=Costmap(cells, 0.05, tick.costmap.origin)))
    end = tick.plan[-2]
    wanted = 5.0 * np.hypot(rollouts.x[-1] - end[0], rollouts.y[-1] - end[1])
    assert PathFollowCritic().cost(rollouts, situation) == pytest.approx(wanted, rel=1e-5)


def test_following_looks_beyond_blocked_points() -> None:
    tick, rollouts = tick_of(free(120)), rolled()
    far = situation_of(tick).furthest(rollouts)
    cells = tick.costmap.cells.copy()
    for mx, my in tick.costmap.world_to_map(tick.plan[far + 5 : far + 9, :2]):
        cells[my, mx] = 254
    situation = situation_of(replace(tick, costmap=Costmap(cells, 0.05, tick.costmap.origin)))
    ahead = far + 6
    while not situation.valid[ahead]:
        ahead += 1
    assert ahead > far + 6
    end = tick.plan[ahead]
    wanted = 5.0 * np.hypot(rollouts.x[-1] - end[0], rollouts.y[-1] - end[1])
    found = PathFollowCritic().cost(rollouts, situation)
    assert found == pytest.approx(wanted, rel=1e-5)


@pytest.mark.parametrize("mode", [0, 1, 2])
@pytest.mark.parametrize("heading", [0.1, 2.0, 3.0])
@pytest.mark.parametrize("path_yaw", [0.3, 2.9])
def test_angles_to_the_path_are_those_of_the_mode(
    mode: int, heading: float, path_yaw: float
) -> None:
    tick = tick_of(free(120))
    plan = tick.plan.copy()
    plan[:, 2] = path_yaw
    pose = np.array([0.02, -0.03, heading])
    rollouts = driven(
        np.full((STEPS, 5), 0.3, np.float32),
        np.linspace(-0.5, 0.5, 5, dtype=np.float32) + np.zeros((STEPS, 1), np.float32),
        pose, 0.05,
    )  # fmt: skip
    situation = situation_of(replace(tick, plan=plan, pose=pose))
    ahead = situation.path[:, min(situation.furthest(rollouts) + 4, 80)].astype(float)

    def error(way: float, yaw: float) -> float:
        """As a robot that may drive backwards sees it."""
        plain, turned = abs(wrap(way - yaw)), abs(wrap(way + pi - yaw))
        if mode == 1:
            return min(plain, turned)
        return turned if mode == 2 and abs(wrap(way - path_yaw)) > 0.5 * pi else plain

    here = error(atan2(ahead[1] - pose[1], ahead[0] - pose[0]), heading)
    found = PathAngleCritic(mode=mode).cost(rollouts, situation)
    assert (found is None) == (here < 0.785398)
    if found is not None:
        ends = zip(rollouts.x[-1], rollouts.y[-1], rollouts.yaw[-1], strict=True)
        wanted = [2.2 * error(atan2(ahead[1] - y, ahead[0] - x), yaw) for x, y, yaw in ends]
        assert found == pytest.approx(wanted, rel=1e-4)


def spotted(share: float = 1.0) -> Costmap:
    """Costs of inflation about some obstacles, and some unknown cells."""
    rng = np.random.default_rng(3)
    cells = rng.integers(0, 180, (120, 120))
    cells[rng.random(cells.shape) < 0.008 * share] = 253
    cells[rng.random(cells.shape) < 0.002 * share] = 254
    cells[rng.random(cells.shape) < 0.003 * share] = 255
    return Costmap(cells.astype(np.uint8), 0.05, (-1.0, -1.0))


@pytest.mark.parametrize("track", [False, True])
@pytest.mark.parametrize("near", [False, True])
def test_costs_are_those_of_a_plain_loop(track: bool, near: bool) -> None:
    costmap, rollouts = spotted(), rolled(4)
    reach = 0.4 if near else 2.0
    tick = tick_of(costmap, reach, track_unknown=track)
    situation = situation_of(tick)
    wanted, distances = [], []
    inscribed = tick.footprint.inscribed
    for k in range(BATCH):
        total = 0.0
        for t in range(0, STEPS, 2):
            cost = int(costmap.at((float(rollouts.x[t, k]), float(rollouts.y[t, k])), 255))
            if cost in (253, 254) or (cost == 255 and not track):
                total = 1e6
                break
            total += 300.0 if cost >= 253 else (0.0 if near else cost)
        wanted.append(3.81 / 254.0 * total / 28)
        raw, repulsion = 0.0, 0.0
        for t in range(STEPS):
            cost = int(costmap.at((float(rollouts.x[t, k]), float(rollouts.y[t, k])), 255))
            if cost in (253, 254) or (cost == 255 and not track):
                raw = 1e5
                break
            if cost:
                gap = (3.0 * inscribed - log(cost) + log(253.0)) / 3.0 - inscribed
                raw += max(0.1 - gap, 0.0)
                repulsion += 0.0 if near else 0.7 - gap
        distances.append((raw, repulsion))
    found = CostCritic().cost(rollouts, situation)
    assert found == pytest.approx(wanted, rel=1e-4)
    assert 0 < sum(value > 500.0 for value in wanted) < BATCH
    assert not situation.all_collide
    raw, repulsion = np.array(distances).T
    critic = ObstaclesCritic(inflation_radius=0.7, cost_scaling_factor=3.0)
    expected = 20.0 * raw + 1.5 * (repulsion - repulsion.min()) / STEPS
    assert critic.cost(rollouts, situation) == pytest.approx(expected, rel=1e-4, abs=1e-4)


@pytest.mark.parametrize("track", [False, True])
@pytest.mark.parametrize("k", [3.0, 40.0])
def test_the_footprint_decides_where_it_is_asked_for(track: bool, k: float) -> None:
    costmap, rollouts = spotted(0.6), rolled(5)
    shape = RobotFootprint.of([[0.3, 0.1], [0.3, -0.1], [-0.3, -0.1], [-0.3, 0.1]])
    tick = tick_of(costmap, footprint=shape, track_unknown=track)
    least = int(252.0 * exp(-k * (shape.circumscribed - shape.inscribed)))
    assert (least == 0) == (k == 40.0) and least < 150
    wanted, distances = [], []
    for i in range(BATCH):
        total, hit = 0.0, False
        raw, repulsion, collided = 0.0, 0.0, False
        for t in range(STEPS):
            pose = np.array([rollouts.x[t, i], rollouts.y[t, i], rollouts.yaw[t, i]], float)
            centre = int(costmap.at(pose[:2], -1))
            under = shape.cost(costmap, pose)
            cost = 255 if centre < 0 else centre
            if t % 2 == 0 and cost >= 1 and not hit:
                seen = under if cost >= max(least, 1) else cost
                hit = seen == 254 or (seen == 255 and not track)
                total += 300.0 if cost >= 253 else cost
            near = centre >= least and centre >= 0
            seen = under if near else cost
            if seen >= 1 and not collided:
                collided = seen == 254 or (seen == 255 and not track)
                gap = (k * shape.inscribed - log(seen) + log(253.0)) / k
                gap -= 0.0 if near else shape.inscribed
                if not collided:
                    raw += max(0.1 - gap, 0.0)
                    repulsion += 0.7 - gap
        wanted.append(3.81 / 254.0 / 28 * (1e6 if hit else total))
        distances.append((1e5 if collided else raw, repulsion))
    critic = CostCritic(consider_footprint=True, cost_scaling_factor=k)
    assert critic.cost(rollouts, situation_of(tick)) == pytest.approx(wanted, rel=1e-4)
    assert 0 < sum(value > 500.0 for value in wanted) < BATCH
    raw_costs, repulsions = np.array(distances).T
    expected = 20.0 * raw_costs + 1.5 * (repulsions - repulsions.min()) / STEPS
    obstacles = ObstaclesCritic(True, consider_footprint=True, inflation_radius=0.7,
                                cost_scaling_factor=k)  # fmt: skip
    found = obstacles.cost(rollouts, situation_of(tick))
    assert found == pytest.approx(expected, rel=1e-4, abs=1e-3)


def test_without_inflation_nothing_is_said_of_distances() -> None:
    critic = ObstaclesCritic(cost_scaling_factor=0.0, collision_cost=7.0)
    found = critic.cost(rolled(4), situation_of(tick_of(spotted())))
    assert found is not None and set(found.tolist()) == {0.0, 140.0}


def test_a_robot_that_cannot_reverse_has_to_face_the_path() -> None:
    tick = tick_of(free(120), pose=np.array([0.02, -0.03, 3.0]))
    rollouts = driven(*np.zeros((2, STEPS, 3), np.float32), tick.pose, 0.05)
    for least, turns in ((-0.35, False), (-1e-5, False), (0.0, True), (-1e-7, True)):
        limits = replace(LIMITS, vx_min=least)
        found = PathAngleCritic(mode=1).cost(rollouts, situation_of(tick, limits))
        assert (found is not None) == turns  # its back is to the path
    facing = PathAngleCritic(mode=0).cost(rollouts, situation_of(tick))
    assert found == pytest.approx(facing)


def test_a_delay_as_long_as_the_horizon_is_refused() -> None:
    for name in ("model_delay_vx", "model_delay_wz"):
        with pytest.raises(WideberthError, match=f"{name} is 2.8 s, as long as the horizon"):
            MPPI(**{name: 2.8})  # type: ignore[arg-type]
        late = MPPI(batch_size=20, **{name: 2.7})  # type: ignore[arg-type]
        assert late.velocity(tick_of(free(120))).twist is not None


def test_a_turning_radius_is_kept() -> None:
    rollouts, limits = rolled(6), replace(LIMITS, turning_radius=1.0)
    found = ConstraintCritic().cost(rollouts, situation_of(tick_of(free(120)), limits))
    vx, wz = rollouts.vx[0].astype(float), rollouts.wz[0].astype(float)
    out = np.maximum(vx - 0.5, 0) + np.maximum(-0.35 - vx, 0) + np.maximum(1 - abs(vx / wz), 0)
    assert found == pytest.approx(4.0 * out * 0.05 * STEPS, rel=1e-4, abs=1e-5)
    controller = MPPI(batch_size=200, motion_model="ackermann", min_turning_r=0.6)
    tick = tick_of(free(120), pose=np.array([0.0, 0.0, 1.5]))
    for _ in range(5):
        twist = controller.velocity(tick).twist
        assert twist is not None
        assert abs(twist.angular) <= abs(twist.linear[0]) / 0.6 + 1e-6


def test_controls_are_followed_as_fast_as_the_robot_can() -> None:
    wanted = np.array([[1.0], [1.0], [-1.0], [-1.0], [-1.0]], np.float32)
    found, _ = followed(wanted, 0.1, (-0.3, 0.2), False)
    assert found[:, 0] == pytest.approx([0.1, 0.3, 0.5, 0.2, -0.1])
    found, kept = followed(wanted, -0.1, (-0.3, 0.2), True)  # mirrored while it moves back
    assert found[:3, 0] == pytest.approx([-0.1, 0.2, 0.4])
    assert kept[:, 0] == pytest.approx([*found[1:, 0], -1.0])


def test_delays_shift_velocities() -> None:
    rows = np.arange(6, dtype=np.float32)[:, None]
    sent = np.array([7.0, 8.0, 9.0], np.float32)
    assert delayed(rows, sent)[:, 0].tolist() == [0.0, 8.0, 9.0, 1.0, 2.0, 3.0]
    assert delayed(rows, sent[:1]) is rows


def test_positions_take_the_yaw_before_the_step() -> None:
    found = driven(
        np.full((2, 1), 0.4, np.float32), np.full((2, 1), 1.0, np.float32),
        np.array([1.0, 2.0, 0.3]), 0.05,
    )  # fmt: skip
    assert found.x[:, 0] == pytest.approx([1 + 0.02 * cos(0.3), 1 + 0.02 * (cos(0.3) + cos(0.35))])
    assert found.y[-1, 0] == pytest.approx(2 + 0.02 * (sin(0.3) + sin(0.35)))


def test_the_filter_keeps_parabolas() -> None:
    controller = MPPI(batch_size=2)
    time = np.arange(-4, 60) * 0.1
    curve = 0.3 - 0.1 * time + 0.02 * time**2
    memory = controller.memory
    memory.history = np.array([curve[:4], curve[:4]])
    memory.controls = np.array([curve[4:], curve[4:]], np.float32)[:, :56]
    before = memory.controls.copy()
    controller._smooth()
    assert memory.controls[:, :52] == pytest.approx(before[:, :52], abs=1e-6)
    assert memory.history[0] == pytest.approx([*curve[1:4], before[0, 1]], abs=1e-6)


def test_limits_are_mirrored_while_it_moves_back() -> None:
    controller = MPPI(batch_size=2, ax_max=1.0, ax_min=-2.0)
    for speed, wanted, after in (
        (0.0, 1.0, 0.05), (-0.1, 1.0, 0.0), (-0.1, -1.0, -0.15), (0.2, -1.0, 0.1),
    ):  # fmt: skip
        controller.memory.controls = np.full((2, STEPS), wanted, np.float32)
        controller._limit(np.array([speed, 0.0]))
        assert controller.memory.controls[0, 1] == pytest.approx(after, abs=1e-6), (speed, wanted)


@dataclass(frozen=True)
class Asked(MppiCritic):
    """Takes note of being asked."""

    calls: list[int] = field(default_factory=list)

    def weighted(self, rollouts: Rollouts, situation: MppiTick) -> None:
        self.calls.append(1)


def test_no_critic_is_asked_once_all_collide() -> None:
    asked = Asked()
    controller = MPPI(critics=(CostCritic(), asked), batch_size=50)
    assert controller.velocity(tick_of(walled())).twist is None
    assert not asked.calls
    assert controller.velocity(tick_of(free(120))).twist is not None
    assert len(asked.calls) == 1


DEFAULTS: dict[str, dict[str, object]] = {
    "ConstraintCritic": {"cost_weight": 4.0},
    "CostCritic": {
        "cost_weight": 3.81, "near_collision_cost": 253, "critical_cost": 300.0,
        "collision_cost": 1e6, "near_goal_distance": 0.5, "trajectory_point_step": 2,
    },
    "GoalCritic": {"cost_weight": 5.0, "threshold_to_consider": 1.4},
    "GoalAngleCritic": {"cost_weight": 3.0, "threshold_to_consider": 0.5},
    "PathAlignCritic": {
        "cost_weight": 10.0, "offset_from_furthest": 20, "max_path_occupancy_ratio": 0.07,
        "trajectory_point_step": 4, "threshold_to_consider": 0.5, "use_path_orientations": False,
    },
    "PathFollowCritic": {
        "cost_weight": 5.0, "threshold_to_consider": 1.4, "offset_from_furthest": 6,
    },
    "PathAngleCritic": {
        "cost_weight": 2.2, "threshold_to_consider": 0.5, "offset_from_furthest": 4,
        "max_angle_to_furthest": 0.785398, "mode": 0,
    },
    "PreferForwardCritic": {"cost_weight": 5.0, "threshold_to_consider": 0.5},
    "TwirlingCritic": {"cost_weight": 10.0},
    "VelocityDeadbandCritic": {"cost_weight": 35.0, "deadband_velocities": (0.0, 0.0, 0.0)},
    "ObstaclesCritic": {
        "critical_weight": 20.0, "repulsion_weight": 1.5, "collision_cost": 1e5,
        "collision_margin_distance": 0.1, "near_goal_distance": 0.5,
    },
}  # fmt: skip


@pytest.mark.parametrize("name", DEFAULTS)
def test_defaults_are_those_of_the_code(name: str) -> None:
    critic = CRITICS[name]()
    assert critic.enabled and critic.cost_power == 1
    for parameter, value in DEFAULTS[name].items():
        assert getattr(critic, parameter) == value, parameter


def settled(controller: MPPI, tick: Tick, count: int = 12) -> list[tuple[float, float]]:
    found = []
    for _ in range(count):
        twist = controller.velocity(tick).twist
        assert twist is not None
        found.append((twist.linear[0], twist.angular))
    return found


def test_equal_calls_have_equal_answers() -> None:
    tick = tick_of(free(120))
    for redraw in (False, True):
        both = [MPPI(batch_size=100, regenerate_noises=redraw) for _ in range(2)]
        first = settled(both[0], tick)
        assert settled(both[1], tick) == first
        for controller in both:
            controller.reset()
            assert not controller.memory.controls.any()
        again = settled(both[0], tick)
        assert settled(both[1], tick) == again != first  # the noise is another
        assert settled(MPPI(batch_size=100, regenerate_noises=redraw, seed=1), tick) != first


def test_the_robot_follows_the_path_within_its_limits() -> None:
    controller = MPPI.from_parameters({**shipped_parameters("mppi"), "batch_size": 500})
    commands = settled(controller, tick_of(free(120)), 30)
    assert commands[-1][0] > 0.4 and commands[-1][1] > 0.0
    assert max(v for v, _ in commands) <= 0.5 + 1e-6
    controller.limit_speed(40.0, percentage=True)
    slow = settled(controller, tick_of(free(120), speed=np.array([0.2, 0.0, 0.0])), 20)
    assert max(v for v, _ in slow[5:]) <= 0.2 + 1e-6
    controller.limit_speed(0.1, percentage=False)
    assert controller.limits.vx_max == pytest.approx(0.1)
    controller.limit_speed(0.0, percentage=False)
    assert controller.limits.vx_max == 0.5


def test_without_a_shift_the_first_control_is_sent() -> None:
    fast = MPPI(batch_size=200, controller_frequency=50.0)
    assert not fast.shifting
    commands = settled(fast, tick_of(free(120)), 15)
    assert fast.memory.controls[0, 0] == np.float32(commands[-1][0])
    assert commands[-1][0] > 0.2


def walled() -> Costmap:
    cells = np.zeros((120, 120), np.uint8)
    cells[:, 57:65] = 254
    return Costmap(cells, 0.05, (-3.0, -3.0))


def test_a_blocked_robot_gets_a_reason_and_forgets() -> None:
    controller = MPPI(batch_size=100)
    answer = controller.velocity(tick_of(walled()))
    assert answer.twist is None and answer.error == "NoValidControl"
    assert answer.reason == "every trajectory collides, in 2 tries"
    assert not controller.memory.controls.any() and not controller.memory.last.any()


def test_the_validator_gives_a_second_chance() -> None:
    cells = np.zeros((120, 120), np.uint8)
    cells[:, 66] = 254  # 0.3 m ahead
    costmap = Costmap(cells, 0.05, (-3.0, -3.0))
    tick = tick_of(costmap, 1.0, 41, speed=np.array([0.5, 0.0, 0.0]))
    for tries in (1, 2):
        controller = MPPI(critics=(GoalCritic(),), batch_size=300, retry_attempt_limit=tries - 1)
        controller.memory.controls[0] = controller.memory.last[0] = 0.5  # sees no obstacle
        noise = controller.memory.noise
        answer = controller.velocity(tick)
        assert controller.memory.noise is not noise  # all was forgotten once
        if tries == 1:
            assert answer.reason == "the mean of the trajectories collides, in 1 try"
        else:
            assert answer.twist is not None


def test_open_loop_trusts_the_last_command() -> None:
    tick = tick_of(free(120), speed=np.array([0.5, 0.0, 0.0]))
    trusting, careful = MPPI(batch_size=50, open_loop=True), MPPI(batch_size=50)
    assert trusting.speed(tick).tolist() == [0.0, 0.0]
    assert careful.speed(tick).tolist() == pytest.approx([0.35, 0.0])


def test_a_power_is_taken_of_the_weighted_value() -> None:
    rollouts, situation = rolled(), situation_of(tick_of(free(120)))
    plain = TwirlingCritic().cost(rollouts, situation)
    square = TwirlingCritic(cost_power=2).cost(rollouts, situation)
    assert plain is not None and square == pytest.approx(plain**2)
    assert TwirlingCritic(enabled=False).cost(rollouts, situation) is None
    near = situation_of(tick_of(free(120), 0.2, 9))
    assert TwirlingCritic().cost(rollouts, near) is None


def test_parameters_have_the_names_of_every_version() -> None:
    for name in ("Ackermann", "ackermann", "car"):
        found = MPPI.from_parameters(
            {"motion_model": name, "car.plugin": "mppi::AckermannMotionModel",
             "car.min_turning_r": 0.4}
            if name == "car"
            else {"motion_model": name, "AckermannConstraints.min_turning_r": 0.4,
                  "TrajectoryValidator.collision_lookahead_time": 1.0}
        )  # fmt: skip
        assert found.motion_model == "ackermann" and found.min_turning_r == 0.4
    assert found.collision_lookahead_time == 2.0
    every = MPPI.from_parameters({"critics": [*CRITICS]})
    assert [type(critic).__name__ for critic in every.critics] == [*CRITICS]


@pytest.mark.parametrize(
    ("parameters", "message"),
    [
        ({"vx_maximum": 0.5}, "did you mean 'vx_max'"),
        ({"critics": ["CostsCritic"]}, "did you mean 'CostCritic'"),
        ({"GoalCritic.weight": 1.0}, r"GoalCritic.weight.*did you mean 'cost_weight'"),
        ({"critics": []}, "at least one critic"),
        ({"sgf_order": 4}, "wanted 1 or 2"),
        ({"motion_model": "Omni"}, "wanted 'diff_drive' or 'ackermann'"),
        ({"controller_frequency": 10.0}, "less than the controller's period"),
        ({"batch_size": 0}, "whole number of at least 1"),
        ({"critics": ["PathAngleCritic"], "PathAngleCritic.mode": 3}, "wanted 0, 1 or 2"),
    ],
)
def test_wrong_parameters_are_refused(parameters: dict[str, object], message: str) -> None:
    with pytest.raises(WideberthError, match=message):
        MPPI.from_parameters(parameters)
