"""Absurd input for all that is called in a control loop, and for configs.

No call may raise, warn, hang, be late, break a limit, return what is not finite, or make an
exception the reason of a status. `make fuzz` runs all of it; other runs try a few parts and
examples, the same ones each time. benchmarks/README.md says what is tried.
"""

import faulthandler
import random
import re
import resource
import signal
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from functools import cache, partial
from itertools import product
from pathlib import Path as File
from time import perf_counter, process_time
from typing import Any

import numpy as np
import pytest
from hypothesis import HealthCheck, Phase, given, settings
from hypothesis import strategies as st

from wideberth.experiments.engine.shipped_configs import read_experiment
from wideberth.framework.control.command_limits import broken_limit
from wideberth.framework.controller import Controller, DrivesRobot
from wideberth.framework.plugins.config import build
from wideberth.framework.plugins.registry import names
from wideberth.framework.predictor import Adaptive
from wideberth.framework.robot import Robot
from wideberth.framework.values.errors import WideberthError
from wideberth.framework.values.motion import Command
from wideberth.framework.values.path import Path
from wideberth.packages.ros.tests.helpers.message_samples import drawn
from wideberth.routes import NavFn
from wideberth.routes.replanning import Replanning
from wideberth.tests.fuzz import absurd
from wideberth.tests.helpers.bags import header, odometry, quaternion, transform, vector
from wideberth.tests.helpers.network import Network
from wideberth_ros.decoding import OBSTACLES
from wideberth_ros.messages import messages
from wideberth_ros.node import PlannerNode
from wideberth_ros.node_settings import NodeSettings
from wideberth_ros.obstacle_sources import ObstacleTopic, ScanTopic
from wideberth_ros.path_sources import GoalTopic, MapPlanner, MapTopic

DEADLINE = 0.45
"""s for one call of a planner, the paper's."""
SECONDS = 2.5
"""s for a call of a predictor or a detector, and for a config."""
HANGS = 120
"""s by the clock after which a call is ended; after twice that its process."""
MEMORY = 12 * 2**30
"""bytes of address space: what asks for more gets a MemoryError."""
TICKS = 25
"""Calls of a controller or a detector, and periods of a node, in one example."""
WHOLE = settings.get_current_profile_name() == "fuzz"
INSIDE = re.compile(r"\b(?!WideberthError)[A-Z]\w*(?:Error|Warning|Exception|Interrupt)\b")
"""An exception or a warning that a controller has caught and made the reason of a status."""
Settings = dict[str, Any]


def examples(many: int) -> settings:
    """Return how many examples `make fuzz` tries; other runs try the same few each time."""
    usual: Any = {} if WHOLE else {"derandomize": True, "database": None}
    return settings(
        max_examples=many if WHOLE else 3, deadline=None, **usual,
        suppress_health_check=list(HealthCheck),
        phases=set(Phase) - {Phase.shrink, Phase.explain},  # it would play hundreds of runs
    )  # fmt: skip


def parts(every: dict[str, Any], *quick: str) -> Any:
    """Return test parameters; all but a few are for `make fuzz`."""
    slow = {name: () if name in quick else pytest.mark.slow for name in every}
    return [pytest.param(name, marks=slow[name], id=name.replace(" ", "-")) for name in every]


@pytest.fixture(autouse=True, scope="module")
def _memory() -> Iterator[None]:
    """Bound the memory of the process meanwhile."""
    before = resource.getrlimit(resource.RLIMIT_AS)
    resource.setrlimit(resource.RLIMIT_AS, (MEMORY, before[1]))
    yield
    resource.setrlimit(resource.RLIMIT_AS, before)


@contextmanager
def watched(limit: float = SECONDS) -> Iterator[None]:
    """Fail where a call is late or hangs.

    Late is more than twice the limit by the clock *and* in processor time of the process: on a
    machine that others use too the clock alone accuses the machine. More than ten times the
    limit by the clock is late whatever the processor did.
    """
    clock, processor = perf_counter(), process_time()
    before = signal.signal(signal.SIGALRM, _hangs)
    signal.setitimer(signal.ITIMER_REAL, HANGS)
    faulthandler.dump_traceback_later(2 * HANGS, exit=True)
    try:
        yield
    finally:
        faulthandler.cancel_dump_traceback_later()
        signal.setitimer(signal.ITIMER_REAL, 0.0)
        signal.signal(signal.SIGALRM, before)
    clock, processor = perf_counter() - clock, process_time() - processor
    late = min(clock, processor) > 2 * limit or clock > 10 * limit
    assert not late, f"late: {clock:.3g} s, {processor:.3g} s of processor time"


def _hangs(*_: Any) -> None:
    raise TimeoutError(f"a call hangs for {HANGS} s")


VARIED = {
    "level": ("fixed", "relaxed",
              {"type": "relaxed", "tail": 0.05, "weight": 1.0, "minimum": 0.0}),
    "penalty": (None, 1e4, 1e5), "horizon": (5, 8, 15), "period": (0.1, 0.5),
    "latency": (0.0, 0.2, 5.0), "margin": (0.0, 0.1, 10.0),
    "fallback": ({"stop_at_end": True}, {"stop_at_end": False}),
    "own_uncertainty": ("open-loop", "feedback"), "starts": ("auto", []),
    "most_obstacles": (1, 2, 5),
}  # fmt: skip
"""Settings that differ from planner to planner, the same in every run."""
PLAIN: Settings = {
    "type": "mpc", "robot": "unicycle", "region": "mahalanobis_ellipse", "predictor": "imm",
    "level": "fixed", "penalty": 1e4, "horizon": 10, "period": 0.2, "deadline": DEADLINE,
    "most_obstacles": 5, "solver": "riccati",
}  # fmt: skip
OPTIONS: dict[str, Settings] = {
    "none": {},
    "ways": {"further_kinds": [{"type": "ways", "region": "mahalanobis_ellipse"}]},
    "hard regions": {"penalty": None},
    "relaxed level": {"level": "relaxed"},
    "withdraw": {"withdraw": True},
    "between_steps": {"further_kinds": [{"type": "between_steps",
                                         "region": "mahalanobis_ellipse"}]},
    "steps_at_rest": {"fallback": {"stop_at_end": True, "steps_at_rest": 2}},
    "latency": {"latency": 0.3},
    "own_uncertainty": {"own_uncertainty": "feedback"},
    "starts": {"starts": ["along", "left", "right", "back-left", "back-right", "wait", "coast",
                          "turn"]},
    "forwards": {"robot": {"type": "unicycle", "max_reverse_speed": 0.0}},
    "contouring": {"cost": "contouring"},
    "no deadline": {"deadline": None},
}  # fmt: skip
"""Optional settings of the planner, each on by itself, and all of those that go together."""
TOGETHER = ("ways", "latency", "own_uncertainty", "withdraw")
OPTIONS["all"] = {key: one for name in TOGETHER for key, one in OPTIONS[name].items()}
OPTIONS["all"] |= {"fallback": {"stop_at_end": True}, "static_region": "separating_line"}
UNICYCLES = ("acp", "cc", "ecp", "fcp", "nav2")
"""Rivals that drive no robot without a heading; all but the last want it to turn on the spot."""


def straight_on(shown: dict[str, Any]) -> Any:
    """Return an action of absurd size, as a policy out of its depth might."""
    return 1e300 * shown["goal"]


@cache
def controllers() -> dict[str, Settings]:
    """Return every region, robot, wall and optional setting in planners, and the rivals."""
    robots, every = names("robots"), ("riccati", "fatrop")
    predictors = [name for name in names("predictors") if name != "game"]  # it minds no deadline
    pairs = [
        (k + turn, {"region": region, "solver": solver})
        for k, region in enumerate(names("regions"))
        for turn, solver in enumerate(every)
    ]
    pairs += [
        (k, {"region": name, "solver": "ipopt"})
        for k, name in enumerate(("mahalanobis_ellipse", "minkowski_sum", "half_plane"))
    ]
    pairs += [(0, {"static_region": wall}) for wall in names("static_regions")]
    found = {}
    for index, (turn, own) in enumerate(pairs):
        rng, robot = random.Random(index), robots[turn % len(robots)]
        flat = 3 not in build("regions", own.get("region", "half_plane")).dimensions
        varied = {key: rng.choice(values) for key, values in VARIED.items()}
        varied |= {"robot": "unicycle" if "3d" in robot and flat else robot}
        varied |= {"predictor": predictors[index % len(predictors)]}
        found[f"planner {index} {' '.join(own.values())}"] = PLAIN | varied | own
    further = [(one, option) for one in names("solvers") for option in list(OPTIONS)[:2]]
    for solver, option in [*further, *((one, option) for one in every for option in OPTIONS)]:
        found[f"{solver} with {option}"] = PLAIN | {"solver": solver} | OPTIONS[option]
    flat_ones = [name for name in robots if "3d" not in name]
    for index, name in enumerate(one for one in names("controllers") if one != "mpc"):
        robot = "unicycle" if name in UNICYCLES else flat_ones[index % len(flat_ones)]
        wraps = name in ("around_crowds", "withdrawing")
        drives = {"controller": {"type": "orca", "robot": robot}} if wraps else {"robot": robot}
        policy = {"policy": f"{__name__}:straight_on"} if name == "policy" else {}
        found[name] = {"type": name} | drives | policy
    return found


@cache
def controller(name: str) -> tuple[Controller, Robot]:
    """Build a controller and compile what it needs; kept for later examples."""
    made: Controller = build("controllers", controllers()[name])
    assert isinstance(made, DrivesRobot)
    made.set_path(Path(5.0 * np.eye(made.robot.dimension)[:1] * [[-1.0], [1.0]]))
    return made, made.robot


def well_said(made: Controller, *further: str) -> None:
    """Fail where an exception is the reason of a status."""
    reason = getattr(made.last_plan, "reason", getattr(made, "reason", ""))
    assert not INSIDE.search("; ".join([str(reason), *further])), reason


@pytest.mark.parametrize("name", parts(controllers(), "dynamic_window", "nav2", "orca",
                                       "social_force"))  # fmt: skip
@examples(8)
@given(data=st.data())
def test_controllers(name: str, data: st.DataObject) -> None:
    (made, robot), stamp = controller(name), 0.0
    made.reset()
    own = vars(made)
    limit = DEADLINE if own.get("deadline") else 2 * SECONDS
    with watched():
        made.set_path(data.draw(absurd.paths(robot.dimension)))
    for _ in range(TICKS):
        stamp = data.draw(absurd.stamps(stamp, made.period))
        seen = data.draw(absurd.observations(robot, stamp, bool(own.get("static_region"))))
        with watched(limit):
            command = made.command(seen)
        assert not broken_limit(robot, command)
        well_said(made)
        plan = made.last_plan
        for part in () if plan is None else ("states", "inputs", "positions", "level"):
            assert np.isfinite(getattr(plan, part)).all(), f"plan.{part}"


@pytest.mark.parametrize("name", parts(dict.fromkeys(names("predictors")), "game", "imm",
                                       "adaptive_conformal"))  # fmt: skip
@examples(2000)
@given(world=absurd.worlds())
def test_predictors(name: str, world: Any) -> None:
    (tracks, steps, scene), used = world, build("predictors", name)
    with watched():
        used = used.update(tracks, scene) if isinstance(used, Adaptive) else used
        forecast = used.predict(tracks, steps, scene)
    assert np.isfinite(forecast.mean).all() and np.isfinite(forecast.covariance).all()
    assert forecast.mean.shape[2] == steps and len(forecast.mean) == len(tracks)


@examples(500)
@given(text=absurd.configs())
def test_configs(text: bytes, tmp_path_factory: pytest.TempPathFactory) -> None:
    """A mutated config is one clear error or a valid plan."""
    path: File = tmp_path_factory.getbasetemp() / "fuzzed.yaml"
    path.write_bytes(text)
    with watched():
        try:
            len(read_experiment(str(path), [])[0].tasks())
        except WideberthError as error:
            assert len(str(error)) < 5000


def sensing() -> dict[str, tuple[Settings, str]]:
    """Return each detector with each tracker."""
    pairs = product(names("detectors"), names("trackers"))
    shapes = {"type": "discs", "shape": [0.3, 0.2], "others": [[0.2], [0.4]]}
    found = {f"{name} {tracker}": ({"type": name}, tracker) for name, tracker in pairs}
    return {"discs of shapes": (shapes, names("trackers")[0])} | found


def looking(name: str) -> tuple[Any, Any]:
    """Build a detector and a tracker."""
    detector, tracker = sensing()[name]
    return build("detectors", detector), build("trackers", tracker)


@pytest.mark.parametrize("name", parts(sensing(), "discs of shapes"))
@examples(40)
@given(data=st.data())
def test_detectors_and_trackers(name: str, data: st.DataObject) -> None:
    (detector, tracker), pose, stamp = looking(name), np.zeros(3), 0.0
    for _ in range(TICKS):
        stamp = data.draw(absurd.stamps(stamp, 0.1))
        pose = pose + np.array([0.05, 0.0, 0.02])
        scan, poses = data.draw(absurd.scans(stamp, pose))
        if scan is None:
            continue
        with watched():
            found = detector.detect(scan, poses)
            if np.isfinite(found.time):
                tracker.update(found)
            tracks = tracker.at(scan.stamp)
        for one in tracks:
            assert np.isfinite(one.state).all() and np.isfinite(one.covariance).all(), one


EPOCH = 1_700_000_000
"""s, of stamps in messages, as Unix counts them."""
DRIVES = ("riccati with all", "dynamic_window", "nav2", "social_force")


def nodes() -> dict[str, tuple[str, Callable[[], Any]]]:
    """Return nodes, the planner and rivals by turns: the controller, and what it sees by."""
    made: dict[str, Callable[[], Any]] = {
        name: partial(lambda name, how: ScanTopic("/scan", *looking(name), how), name, how)
        for name, how in zip(sensing(), ("measured", "filtered") * len(sensing()), strict=False)
    }
    made |= {kind: partial(ObstacleTopic, "/obstacles", kind) for kind in sorted(OBSTACLES)}
    return {name: (DRIVES[k % len(DRIVES)], sees) for k, (name, sees) in enumerate(made.items())}


class Heard:
    """What a node is sent, period by period."""

    def __init__(self, data: st.DataObject, network: Network) -> None:
        self.data, self.network, self.pose = data, network, np.zeros(3)

    def come(self, topic: str, message: Any) -> None:
        """Send the node a message, some of it absurd, if it listens."""
        if topic in self.network.wires and not absurd.rarely(self.data.draw, 20):
            message = self.data.draw(absurd.corrupted(message))
            self.network.wires[topic].come.append(message)

    def stamped(self, topic: str, kind: str, frame: str, **fields: Any) -> None:
        """Send a message of a type with a header and these fields."""
        stamp = header(EPOCH + self.now, frame)
        self.come(topic, messages().make(kind, header=stamp, **fields))

    def period(self, tick: int, now: float) -> None:
        """Send what comes in a period."""
        self.now, self.pose = now, self.pose + np.array([0.02, 0.0, 0.005])
        self.come("/tf_static", transform(EPOCH, "base_link", "laser", (0.2, 0.0, 0.1)))
        self.come("/tf", transform(EPOCH + now, "map", "odom", (0.5, 0.2, 0.1)))
        self.come("/odom", odometry(EPOCH + now, self.pose, (0.4, 0.0, 0.1)))
        if "/scan" in self.network.wires and tick % 2 == 0:
            beams = self.data.draw(st.sampled_from((180, 180, 0, 1, 2, 60)))
            with np.errstate(all="ignore"):
                ranges = self.data.draw(absurd.measured(self.pose, beams)).astype(np.float32)
            self.stamped(
                "/scan", "sensor_msgs/msg/LaserScan", "laser", ranges=ranges,
                angle_min=-np.pi, angle_max=np.pi, range_min=0.05, range_max=15.0,
                angle_increment=2.0 * np.pi / max(beams, 1), time_increment=0.1 / max(beams, 1),
            )  # fmt: skip
        if wire := self.network.wires.get("/obstacles"):
            message = drawn(wire.kind, self.data.draw(absurd.GENERATORS))
            message.header = header(EPOCH + now, "odom")
            self.come("/obstacles", message)
        if tick == 0 or absurd.rarely(self.data.draw):
            self.stamped("/goal_pose", "geometry_msgs/msg/PoseStamped", "map", pose=at(8.0, 1.0))
            cells = np.pad(np.zeros((74, 164), np.int8), 3, constant_values=100).ravel()
            info = messages().make("nav_msgs/msg/MapMetaData", resolution=0.1, width=170,
                                   height=80, origin=at(-4.5, -3.5))  # fmt: skip
            self.stamped("/map", "nav_msgs/msg/OccupancyGrid", "map", info=info, data=cells)


def at(x: float, y: float) -> Any:
    """Return a pose of heading 0."""
    turn = quaternion(0.0)
    return messages().make(
        "geometry_msgs/msg/Pose", position=vector("Point", x, y), orientation=turn
    )


@pytest.mark.parametrize("name", parts(nodes(), [*nodes()][1]))
@examples(8)
@given(data=st.data())
def test_nodes(name: str, data: st.DataObject) -> None:
    drives, sees = nodes()[name]
    (made, robot), network, now = controller(drives), Network(), 5.0
    made.reset()
    follows = GoalTopic(over=MapPlanner(MapTopic(), Replanning(NavFn())))
    own = NodeSettings(sees=sees(), follows=follows if data.draw(st.booleans()) else GoalTopic())
    node = PlannerNode(made, robot, own, network, lambda: now)
    node.warm_up()
    caught, take = [], node._take

    def noted(*given: Any) -> None:
        try:
            take(*given)
        except WideberthError:  # its way to refuse a message
            raise
        except Exception as error:  # the node itself goes on, and counts it as refused
            caught.append(f"{given[0]}: {type(error).__name__}: {error}")
            raise

    node._take = noted  # type: ignore[method-assign]
    heard = Heard(data, network)
    for tick in range(TICKS):
        heard.period(tick, now)
        with watched(DEADLINE):
            network.deliver()
        assert not caught
        with watched(DEADLINE if drives == DRIVES[0] else 2 * SECONDS):
            node.plan()
        assert not node.counts.failures, node.status
        well_said(made, node.status)
        with watched(DEADLINE):
            node.publish_plan()
            node.publish_diagnostics()
            sent = node.publish()
        if sent and (gone := network.wires["/cmd_vel"].gone):
            twist = gone[0].twist
            command = Command((twist.linear.x, twist.linear.y), twist.angular.z)
            assert not broken_limit(robot, command)
        now += data.draw(st.sampled_from((0.05, 0.05, 0.05, 0.05, 0.0, 1.0)))


def test_what_is_late_or_hangs_is_found(monkeypatch: pytest.MonkeyPatch) -> None:
    until = process_time() + 0.03
    with pytest.raises(AssertionError, match="late"), watched(0.001):
        while process_time() < until:
            pass
    monkeypatch.setattr(f"{__name__}.HANGS", 0.2)
    with pytest.raises(TimeoutError), watched():
        while True:
            pass
