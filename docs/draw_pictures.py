"""Draw the film of the README and the pictures of pages and gallery: `make pictures` writes them.

`python docs/draw_pictures.py NAME ...` draws only these pictures of the gallery.
"""

import sys

import matplotlib
import numpy as np
from _site import DOCS, gallery

import wideberth
from wideberth import Costmap, Inflation, OccupancyGrid, build, convex_polygons, draw
from wideberth.draw import ellipses
from wideberth.routes import NavFn, SmoothedRoutes
from wideberth.simulation import RobotAgent, ScriptedAgent, Settings, run_episode
from wideberth.tests.helpers.driven import driven, in_order, instant, room, scans
from wideberth.tests.oracles.ray_casting import box_corners, scan_of

matplotlib.use("Agg")
import matplotlib.pyplot as plt
from matplotlib.animation import FuncAnimation

FIGURES = DOCS / "figures"
BLUE, RED, GREEN, PINK = "#0072b2", "#d55e00", "#009e73", "#cc79a7"
WALKERS = (  # name, from, to, speed in m/s, when it starts in s
    ("anna", (5.0, -4.5), (5.0, 8.0), 0.8, 0.0),
    ("ben", (11.0, 4.0), (7.5, -8.0), 0.9, 4.0),
)


def film() -> None:
    """Film the recommended planner, which drives past two people who cross its way."""
    planner = wideberth.recommended("unicycle", speed=1.0, quiet=True)
    robot = RobotAgent("robot", planner.robot, planner, wideberth.Path([(0, 0), (14, 0)]), 1.0)
    people = [
        ScriptedAgent(name, wideberth.Path([start, end]), speed, radius=0.3, start=begin)
        for name, start, end, speed, begin in WALKERS
    ]
    episode = run_episode([robot], Settings(time_limit=20.0, history=10.0), others=people)
    figure, panel = plt.subplots(figsize=(6.4, 2.9), layout="constrained")

    def show(time: float) -> None:
        panel.clear()
        panel.plot([0, 14], [0, 0], color="0.8", linewidth=1, zorder=0)
        draw.plan([plan for plan in episode.robots[0].plans if plan.stamp <= time][-1], panel)
        for agent in episode.agents:
            colour = "#1b1b1b" if agent in episode.robots else RED
            place = episode.at(agent, np.array([time]))[0][:2]
            panel.add_patch(plt.Circle(place, agent.radius, color=colour, zorder=3))
        panel.set_title("", loc="left")
        panel.set(xlim=(-1.0, 15.0), ylim=(-3.6, 3.6), aspect="equal")
        panel.set_axis_off()

    target = FIGURES / "episode.gif"
    times = np.arange(0.0, episode.duration, 0.35)
    FuncAnimation(figure, show, times, interval=175).save(target, writer="pillow", dpi=100)
    gallery.shrink(target, target, 640, most=len(times))


def routes() -> None:
    """Draw a map with its inflation, a route before and after smoothing, and its polygons."""
    mx, my = np.meshgrid(np.arange(160), np.arange(100))
    wall = (mx < 3) | (mx > 156) | (my < 3) | (my > 96)
    wall |= (np.abs(mx - 50) < 2) & (my < 62)
    wall |= (np.abs(my - 0.45 * mx) < 2) & (mx > 90) & (mx < 135)
    wall |= np.hypot(mx - 75, my - 72) < 7
    cells = np.where(wall, 100, 0)
    cells[80:97, 130:157] = -1  # never seen
    grid = OccupancyGrid(cells, resolution=0.1)
    layer = Inflation(inscribed_radius=0.3, inflation_radius=1.2, cost_scaling_factor=3.0)
    costmap = layer.inflated(Costmap.from_grid(grid))
    figure, panels = plt.subplots(1, 2, figsize=(9.6, 3.6), layout="constrained", sharey=True)
    draw.grid(costmap, panels[0])
    for planner, style, label in (
        (NavFn(), "--", "NavFn"),
        (SmoothedRoutes(length=0.8), "-", "smoothed"),
    ):
        path = planner.plan(costmap, (1.5, 1.5), (14.2, 2.0)).path
        panels[0].plot(*path.points.T, style, color=RED, linewidth=1.4, label=label)
    polygons = convex_polygons(grid, tolerance=0.1)
    draw.grid(grid, panels[1])
    outline(panels[1], [one.points for one in polygons], BLUE)
    panels[0].legend(loc="upper left", framealpha=1.0)
    panels[0].set(title="costs and routes")
    panels[1].set(title=f"{len(polygons)} polygons")
    figure.savefig(FIGURES / "routes.png", dpi=110, bbox_inches="tight")


def outline(panel, shapes, colour: str) -> None:
    """Draw outlines in a colour."""
    for shape in shapes:
        panel.fill(*shape.T, facecolor="none", edgecolor=colour, linewidth=1.2)


def own_state() -> None:
    """Draw a drive as two filters and a map believe it, and the errors beside the deviations."""
    rng = np.random.default_rng(15)
    run, walls = driven(rng, 40.0), room()
    samples = in_order(run.samples, scans(run, walls, rng))
    figure, (plane, panel) = plt.subplots(1, 2, figsize=(9.6, 4.2), layout="constrained")
    for wall in walls:
        plane.fill(*wall.points.T, color="0.7")
    plane.plot(*run.truth[:, :2].T, color="k", linewidth=1.0, label="truth")
    for name, settings, colour, marker in (
        ("ekf, robot_localization", {"type": "ekf", "noise": "robot_localization"}, PINK, "^"),
        ("ekf, small", {"type": "ekf"}, RED, "o"),
        ("scan_matching", {"type": "scan_matching", "walls": walls}, BLUE, "s"),
    ):
        estimator = build("state_estimators", settings)
        estimator.reset(np.zeros(3), 0.0)
        found, waiting = [], list(samples)
        for time in np.arange(0.5, run.times[-1], 0.5):
            while waiting and instant(waiting[0]) <= time:
                estimator.take(waiting.pop(0))
            found.append(estimator.at(float(time)))
        times = [one.time for one in found]
        true = np.stack([np.interp(times, run.times, run.truth[:, i]) for i in (0, 1)], axis=1)
        means = np.array([one.mean[:2] for one in found])
        covariances = np.array([one.covariance[:2, :2] for one in found])
        deviation = np.sqrt(np.trace(covariances, axis1=1, axis2=2))
        look = {"color": colour, "marker": marker, "markevery": 8, "markersize": 4.0}
        panel.semilogy(times, np.hypot(*(means - true).T), **look)
        panel.semilogy(times, deviation, "--", linewidth=0.9, **look)
        plane.plot(*means.T, linewidth=0.9, label=name, **look)
        outline(plane, ellipses(means[15::16], covariances[15::16], 5.991), colour)
    plane.set(xlim=(-13.5, 13.5), ylim=(-13.5, 13.5), aspect="equal")
    plane.set(xlabel="x in m", ylabel="y in m", title="a drive of 40 s, ellipses of 95 %")
    panel.set(xlabel="time in s", ylabel="m", ylim=(1e-4, 30.0))
    panel.set_title("error of the position; dashed: its deviation")
    plane.legend(loc="lower right", fontsize="small")
    figure.savefig(FIGURES / "own-state.png", dpi=110, bbox_inches="tight")


def tracking() -> None:
    """Draw a scan and the tracks after 4.4 s; beside it a cylinder and a box, enlarged."""
    rng, poses, end = np.random.default_rng(17), np.zeros((360, 3)), 4.4
    detector, tracker = build("detectors", "over_time"), build("trackers", "nearest")
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
    panels = figure.subplot_mosaic("ab;ac", width_ratios=(2.4, 1))
    panel = panels["a"]
    panel.fill(*wall.T, *pillar.T, color="0.85")
    for place in walkers:
        panel.add_patch(plt.Circle(place, 0.3, facecolor="none", edgecolor="k", linewidth=0.8))
    show(panel, scan, seen)
    panel.plot(*seen.static.T, ".", color=GREEN, markersize=2.5, label="stands still")
    for one, later in zip(tracker.at(end), tracker.at(end + 1.0), strict=True):
        x, y = one.state[:2]
        panel.annotate("", later.state[:2], (x, y), arrowprops={"arrowstyle": "->", "color": BLUE})
        outline(
            panel, ellipses(later.state[None, :2], later.covariance[None, :2, :2], 5.991), BLUE
        )
        panel.text(x - 0.55, y + 0.35, one.ident, color=BLUE)
    panel.plot(0, 0, "^", color="k")
    panel.plot([], [], color=BLUE, label="tracks, 1 s ahead (95 %)")
    panel.set(xlim=(-6.6, 6.2), ylim=(-3.7, 5.9), aspect="equal", xlabel="x in m", ylabel="y in m")
    panel.legend(loc="upper left", fontsize="small", framealpha=1.0)
    centre, angle = np.array([0.0, 4.0]), np.linspace(0.0, 2.0 * np.pi, 100)
    disc = centre + 0.75 * np.stack([np.cos(angle), np.sin(angle)], axis=-1)
    box = box_corners(centre, (0.6, 0.45), 0.9)
    for panel, shape, body, *bodies in (
        (panels["b"], [0.75], disc, [(centre, 0.75)]),
        (panels["c"], [0.6, 0.45], box, [], [box]),
    ):
        scan = scan_of(poses, np.random.default_rng(3), *bodies)
        seen = build("detectors", {"type": "discs", "shape": shape}).detect(scan, poses)
        panel.fill(*body.T, facecolor="0.93", edgecolor="k", linewidth=0.8)
        show(panel, scan, seen)
        panel.plot(*centre, "x", color="k", markersize=6)
        outline(panel, ellipses(seen.positions, seen.covariance, 5.991), RED)
        panel.set(xlim=(-0.95, 0.95), ylim=(3.15, 4.85), aspect="equal")
        panel.set_axis_off()
    figure.savefig(FIGURES / "tracking.png", dpi=110, bbox_inches="tight")


def show(panel, scan, seen) -> None:
    """Draw the points of a scan by a sensor at the origin, and its detections."""
    ranges = np.where(scan.met, scan.ranges, np.nan)
    points = ranges * [np.cos(scan.bearings), np.sin(scan.bearings)]
    panel.plot(*points, ".", color="0.35", markersize=2.5, label="scan")
    panel.plot(*seen.positions.T, "+", color=RED, markersize=9, label="detections")


if __name__ == "__main__":
    gallery.draw(sys.argv[1:])
    if not sys.argv[1:]:
        film()
        routes()
        own_state()
        tracking()
