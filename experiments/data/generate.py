"""Make the synthetic recordings in this folder: ``python experiments/data/generate.py``."""

from pathlib import Path

import numpy as np

CROWD_SEED, ROBOT_SEED, PLAZA_SEED = 2024, 2025, 2026


def crowd(rng: np.random.Generator, walkers: int = 12, rows: int = 60, dt: float = 0.4) -> str:
    """Return people who cross a plaza of 16 m by 10 m, as rows ``frame id x y``.

    Velocities wander about a preferred one (an AR(1) with 0.9 per step); positions carry
    1 cm of measurement noise. One person in six stands. Frames count by ten.
    """
    seen: list[tuple[int, int, float, float]] = []
    for ident in range(1, walkers + 1):
        heading = rng.choice([0.0, np.pi, np.pi / 2, -np.pi / 2]) + 0.2 * rng.standard_normal()
        speed = 0.0 if ident % 6 == 0 else rng.uniform(0.7, 1.5)
        wanted = speed * np.array([np.cos(heading), np.sin(heading)])
        middle, at = rng.uniform([-4.0, -3.0], [4.0, 3.0]), rng.integers(15, rows - 15)
        wobble = np.zeros((rows, 2))
        for row in range(1, rows):
            wobble[row] = 0.9 * wobble[row - 1] + 0.04 * rng.standard_normal(2) * (speed > 0)
        path = np.cumsum(dt * (wanted + wobble), axis=0)
        path += middle - path[at] + 0.01 * rng.standard_normal((rows, 2))
        inside = np.flatnonzero((np.abs(path) < [8.0, 5.0]).all(axis=1))
        seen += [(10 * int(k), ident, float(path[k, 0]), float(path[k, 1])) for k in inside]
    lines = [f"{frame}\t{ident}\t{x:.3f}\t{y:.3f}" for frame, ident, x, y in sorted(seen)]
    return "\n".join(["# frame id x_m y_m (synthetic, 0.4 s between rows)", *lines, ""])


def robot(rng: np.random.Generator, seconds: float = 60.0, dt: float = 0.1) -> str:
    """Return a unicycle that turns to and fro, as rows ``time x y theta``.

    Speed and yaw rate follow smooth references; 2 mm and 2 mrad of measurement noise.
    """
    count = round(seconds / dt)
    clock = dt * np.arange(count)
    speed = 0.5 + 0.15 * np.sin(2 * np.pi * clock / 17.0)
    turn = 0.25 * np.sin(2 * np.pi * clock / 23.0)
    heading = np.cumsum(turn * dt)
    x, y = np.cumsum(speed * np.cos(heading) * dt), np.cumsum(speed * np.sin(heading) * dt)
    table = np.stack([x, y, heading]) + 0.002 * rng.standard_normal((3, count))
    lines = [
        f"{1000 + t:.1f} {a:.4f} {b:.4f} {c:.4f}"
        for t, (a, b, c) in zip(clock, table.T, strict=True)
    ]
    return "\n".join(["# time_s x_m y_m theta_rad (synthetic)", *lines, ""])


def main() -> None:
    """Write the files beside this one; the plaza holds enough to fit a predictor to."""
    folder = Path(__file__).parent
    (folder / "crowd.txt").write_text(crowd(np.random.default_rng(CROWD_SEED)))
    plaza = crowd(np.random.default_rng(PLAZA_SEED), walkers=48, rows=150)
    (folder / "plaza.txt").write_text(plaza)
    (folder / "robot.txt").write_text(robot(np.random.default_rng(ROBOT_SEED)))


if __name__ == "__main__":
    main()
