"""Draw the film of the README and the pictures of pages and gallery: `make pictures` writes them.

`python docs/draw_pictures.py NAME ...` draws only these pictures of the gallery.
"""

import io
import sys
from pathlib import Path

import matplotlib
import numpy as np
from _site import gallery
from PIL import Image

import wideberth
from wideberth import Costmap, GaussianObstacle, Inflation, OccupancyGrid, convex_polygons, draw
from wideberth.draw import ellipses
from wideberth.framework import Scan
from wideberth.routes import NavFn, SmoothedRoutes
from wideberth.simulation import Episode, RobotAgent, ScriptedAgent, Settings, run_episode
from wideberth.tests.helpers.driven import driven, in_order, instant, room, scans
from wideberth.tests.oracles.ray_casting import box_corners, scan_of

matplotlib.use("Agg")
import matplotlib.pyplot as plt

FOLDER = Path(__file__).resolve().parent / "figures"
EVERY = 4  # steps of the plan from one drawn region to the next
FRAME = 0.25  # s of the episode
SIZE = (6.4, 2.9)  # inch
WALKERS = (  # name, from, to, speed in m/s, when it starts in s
    ("anna", (5.0, -4.5), (5.0, 8.0), 0.8, 0.0),
    ("ben", (11.0, 4.0), (7.5, -8.0), 0.9, 4.0),
)


def drive() -> tuple[wideberth.Controller, Episode]:
    """Let the recommended planner drive past two people who cross its way."""
    planner = wideberth.recommended("unicycle", speed=1.0, quiet=True)
    robot = RobotAgent("robot", planner.robot, planner, wideberth.Path([(0, 0), (14, 0)]), 1.0)
    people = [
        ScriptedAgent(name, wideberth.Path([start, end]), speed, radius=0.3, start=begin)
        for name, start, end, speed, begin in WALKERS
    ]
    settings = Settings(time_limit=20.0, history=10.0)
    return planner, run_episode([robot], settings, others=people)


def draw_plan(panel, planner, episode: Episode, time: float) -> None:
    """Draw one moment: bodies, the plan, and in its colours the regions that it keeps out of."""
    (robot,) = episode.robots
    plans = [plan for plan in robot.plans if plan.stamp <= time + 1e-9]
    now = np.array([time])
    panel.plot([0, 14], [0, 0], color="0.8", linewidth=1, zorder=0)
    for agent in episode.agents:
        x, y = episode.at(agent, now)[0][:2]
        colour = "#1b1b1b" if agent is robot else "#d55e00"
        panel.add_patch(plt.Circle((x, y), agent.radius, color=colour, zorder=3))
    if plans:
        steps(panel, planner, plans[-1])
    panel.set(xlim=(-1.0, 15.0), ylim=(-3.6, 3.6), aspect="equal")
    panel.set_axis_off()


def steps(panel, planner, plan) -> None:
    """Draw every fourth planned position, and the regions of that step in the same colour."""
    panel.plot(*plan.positions.T, color="0.4", linewidth=1)
    margin = np.asarray(planner.robot.radius + 0.3 + planner.margin)
    for step in range(EVERY - 1, len(plan.level), EVERY):
        colour = plt.cm.viridis(step / len(plan.level))
        panel.plot(*plan.positions[step + 1], "o", color=colour, markersize=5, zorder=4)
        for slot in range(len(plan.forecast.mean)):
            mean = plan.forecast.mean[slot, 0, step]
            obstacle = GaussianObstacle(mean, plan.forecast.covariance[slot, 0, step])
            shape = planner.region.parameters(obstacle, margin)
            curve = planner.region.boundary(shape, float(plan.level[step, slot]), 80)
            panel.fill(*curve.T, color=colour, alpha=0.25, linewidth=0)
            panel.plot(*np.append(curve, curve[:1], axis=0).T, color=colour, linewidth=0.8)


def image(planner, episode: Episode, time: float, dpi: int) -> Image.Image:
    """Return one moment as an image."""
    figure, panel = plt.subplots(figsize=SIZE, layout="constrained")
    draw_plan(panel, planner, episode, time)
    buffer = io.BytesIO()
    figure.savefig(buffer, dpi=dpi)
    plt.close(figure)
    return Image.open(buffer).convert("RGB")


def film(planner, episode: Episode) -> bytes:
    """Return the episode as a GIF of few colours."""
    times = np.arange(0.0, episode.duration, FRAME)
    frames = [image(planner, episode, time, dpi=100) for time in times]
    palette = frames[len(frames) // 3].quantize(colors=48)
    small = [frame.quantize(palette=palette, dither=Image.Dither.NONE) for frame in frames]
    buffer = io.BytesIO()
    small[0].save(
        buffer, format="GIF", save_all=True, append_images=small[1:], duration=125, loop=0,
        optimize=True,
    )  # fmt: skip
    return buffer.getvalue()


def hall() -> OccupancyGrid:
    """Return the map of a hall: walls, a slanted one, a round pillar, places never seen."""
    mx, my = np.meshgrid(np.arange(160), np.arange(100))
    wall = (mx < 3) | (mx > 156) | (my < 3) | (my > 96)
    wall |= (np.abs(mx - 50) < 2) & (my < 62)
    wall |= (np.abs(my - 0.45 * mx) < 2) & (mx > 90) & (mx < 135)
    wall |= np.hypot(mx - 75, my - 72) < 7
    cells = np.where(wall, 100, 0)
    cells[80:97, 130:157] = -1
    return OccupancyGrid(cells, resolution=0.1)


def route(file: Path) -> None:
    """Draw a map with its inflation, a route before and after smoothing, and its polygons."""
    grid = hall()
    layer = Inflation(inscribed_radius=0.3, inflation_radius=1.2, cost_scaling_factor=3.0)
    costmap = layer.inflated(Costmap.from_grid(grid))
    figure, panels = plt.subplots(1, 2, figsize=(9.6, 3.6), layout="constrained", sharey=True)
    draw.grid(costmap, panels[0])
    for planner, style, label in (
        (NavFn(), "--", "NavFn"),
        (SmoothedRoutes(length=0.8), "-", "smoothed"),
    ):
        path = planner.plan(costmap, (1.5, 1.5), (14.2, 2.0)).path
        panels[0].plot(*path.points.T, style, color="#d55e00", linewidth=1.4, label=label)
    polygons = convex_polygons(grid, tolerance=0.1)
    draw.grid(grid, panels[1])
    for one in polygons:
        panels[1].fill(*one.points.T, facecolor="none", edgecolor="#0072b2", linewidth=1.2)
    panels[0].legend(loc="upper left", framealpha=1.0)
    panels[0].set(title="costs and routes")
    panels[1].set(title=f"{len(polygons)} polygons")
    figure.savefig(file, dpi=110, bbox_inches="tight")
    plt.close(figure)


def own_state(file: Path) -> None:
    """Draw a drive as two filters and a map believe it, and the errors beside the deviations."""
    rng = np.random.default_rng(15)
    run, walls = driven(rng, 40.0), room()
    samples = in_order(run.samples, scans(run, walls, rng))
    figure, (plane, panel) = plt.subplots(1, 2, figsize=(9.6, 4.2), layout="constrained")
    for wall in walls:
        plane.fill(*wall.points.T, color="0.7")
    plane.plot(*run.truth[:, :2].T, color="k", linewidth=1.0, label="truth")
    localization = {"type": "ekf", "noise": "robot_localization"}
    for name, settings, colour, marker in (
        ("ekf, robot_localization", localization, "#cc79a7", "^"),
        ("ekf, small", {"type": "ekf"}, "#d55e00", "o"),
        ("scan_matching", {"type": "scan_matching", "walls": walls}, "#0072b2", "s"),
    ):
        estimator = wideberth.build("state_estimators", settings)
        estimator.reset(np.zeros(3), 0.0)
        found, waiting = [], list(samples)
        for time in np.arange(0.5, run.times[-1], 0.5):
            while waiting and instant(waiting[0]) <= time:
                estimator.take(waiting.pop(0))
            found.append(estimator.at(float(time)))
        times = np.array([one.time for one in found])
        true = np.stack([np.interp(times, run.times, run.truth[:, i]) for i in (0, 1)], axis=1)
        means = np.array([one.mean[:2] for one in found])
        covariances = np.array([one.covariance[:2, :2] for one in found])
        off = np.hypot(*(means - true).T)
        look = {"color": colour, "marker": marker, "markevery": 8, "markersize": 4.0}
        panel.semilogy(times, off, **look)
        deviation = np.sqrt(np.trace(covariances, axis1=1, axis2=2))
        panel.semilogy(times, deviation, "--", linewidth=0.9, **look)
        plane.plot(*means.T, linewidth=0.9, label=name, **look)
        for outline in ellipses(means[15::16], covariances[15::16], 5.991):
            plane.fill(*outline.T, facecolor="none", edgecolor=colour, linewidth=1.2)
    plane.set(xlim=(-13.5, 13.5), ylim=(-13.5, 13.5), aspect="equal")
    plane.set(xlabel="x in m", ylabel="y in m", title="a drive of 40 s, ellipses of 95 %")
    panel.set(xlabel="time in s", ylabel="m", ylim=(1e-4, 30.0))
    panel.set_title("error of the position; dashed: its deviation")
    plane.legend(loc="lower right", fontsize="small")
    figure.savefig(file, dpi=110, bbox_inches="tight")
    plt.close(figure)


def tracking(file: Path) -> None:
    """Draw a scan and the tracks after 4.4 s; beside it a cylinder and a box, enlarged."""
    rng, poses, end = np.random.default_rng(17), np.zeros((360, 3)), 4.4
    detector = wideberth.build("detectors", "over_time")
    tracker = wideberth.build("trackers", "nearest")
    wall = np.array([[-6.5, -3.4], [6.0, -3.4], [6.0, -3.2], [-6.5, -3.2]])
    pillar = box_corners(np.array([0.7, 2.1]), (0.45, 0.3), 0.3)
    start = np.array([[-3.4, 3.9], [3.6, 4.9], [-4.4, -1.6], [4.4, -2.0]])
    pace = np.array([[0.95, 0.05], [-0.1, -0.9], [0.25, 0.15], [0.0, 0.6]])
    for time in np.arange(0.1, end + 0.05, 0.1):
        walkers = start + time * pace
        discs = [(place, 0.3) for place in walkers]
        scan = scan_of(poses, rng, discs, [wall, pillar], end=float(time), dropped=0.01)
        seen = detector.detect(scan, poses)
        tracker.update(seen)
    figure = plt.figure(figsize=(9.6, 4.6), layout="constrained")
    panels = figure.subplot_mosaic(
        [["scene", "cylinder"], ["scene", "box"]], width_ratios=(2.4, 1)
    )
    panel = panels["scene"]
    for outline in (wall, pillar):
        panel.fill(*outline.T, color="0.85")
    for place in walkers:
        panel.add_patch(plt.Circle(place, 0.3, facecolor="none", edgecolor="k", linewidth=0.8))
    panel.plot(*met(scan), ".", color="0.35", markersize=2.5, label="scan")
    panel.plot(*seen.static.T, ".", color="#009e73", markersize=2.5, label="stands still")
    panel.plot(*seen.positions.T, "+", color="#d55e00", markersize=9, label="detections")
    for one, later in zip(tracker.at(end), tracker.at(end + 1.0), strict=True):
        x, y = one.state[:2]
        arrow = {"arrowstyle": "->", "color": "#0072b2"}
        panel.annotate("", later.state[:2], (x, y), arrowprops=arrow)
        (outline,) = ellipses(later.state[None, :2], later.covariance[None, :2, :2], 5.991)
        panel.fill(*outline.T, facecolor="none", edgecolor="#0072b2", linewidth=1.0)
        panel.text(x - 0.55, y + 0.35, one.ident, color="#0072b2")
    panel.plot(0, 0, "^", color="k")
    panel.plot([], [], color="#0072b2", label="tracks, 1 s ahead (95 %)")
    panel.set(xlim=(-6.6, 6.2), ylim=(-3.7, 5.9), aspect="equal", xlabel="x in m", ylabel="y in m")
    panel.legend(loc="upper left", fontsize="small", framealpha=1.0)
    enlarged(panels["cylinder"], (0.75,))
    enlarged(panels["box"], (0.6, 0.45))
    figure.savefig(file, dpi=110, bbox_inches="tight")
    plt.close(figure)


def met(scan: Scan) -> np.ndarray:
    """Return the points of a scan by a sensor at the origin, (2, B)."""
    ranges = np.where(scan.met, scan.ranges, np.nan)
    return ranges * [np.cos(scan.bearings), np.sin(scan.bearings)]


def enlarged(panel, shape: tuple[float, ...]) -> None:
    """Draw what a scan meets of a body 4 m away, and where its centre is found."""
    centre, poses, rng = np.array([0.0, 4.0]), np.zeros((360, 3)), np.random.default_rng(3)
    if len(shape) == 1:
        angle = np.linspace(0.0, 2.0 * np.pi, 100)
        body = centre + shape[0] * np.stack([np.cos(angle), np.sin(angle)], axis=-1)
        scan = scan_of(poses, rng, [(centre, shape[0])])
    else:
        body = box_corners(centre, shape, 0.9)
        scan = scan_of(poses, rng, [], [body])
    seen = wideberth.build("detectors", {"type": "discs", "shape": list(shape)}).detect(
        scan, poses
    )
    panel.fill(*body.T, facecolor="0.93", edgecolor="k", linewidth=0.8)
    panel.plot(*met(scan), ".", color="0.35", markersize=4)
    panel.plot(*centre, "x", color="k", markersize=6)
    panel.plot(*seen.positions.T, "+", color="#d55e00", markersize=9)
    for outline in ellipses(seen.positions, seen.covariance, 5.991):
        panel.fill(*outline.T, facecolor="none", edgecolor="#d55e00", linewidth=1.2)
    panel.set(xlim=(-0.95, 0.95), ylim=(3.15, 4.85), aspect="equal")
    panel.set_axis_off()


if __name__ == "__main__":
    gallery.draw(sys.argv[1:])
    if sys.argv[1:]:
        sys.exit()
    planner, episode = drive()
    FOLDER.mkdir(exist_ok=True)
    route(FOLDER / "routes.png")
    own_state(FOLDER / "own-state.png")
    tracking(FOLDER / "tracking.png")
    written = FOLDER / "episode.gif"
    written.write_bytes(film(planner, episode))
    print(f"{written}: {written.stat().st_size / 1e3:.0f} kB, {episode.duration:.1f} s")
