"""How a robot drives, on motions with a closed form: circle, sine, straight braking."""

import numpy as np
import pytest

from wideberth.metrics import motion as motion

STEP = 0.1
TIMES = STEP * np.arange(201)


def circle(radius: float, turn: float) -> np.ndarray:
    return radius * np.stack([np.cos(turn * TIMES), np.sin(turn * TIMES)], axis=1)


def test_a_circle() -> None:
    """Each difference multiplies by 2 sin(omega h / 2) / h instead of omega."""
    radius, turn = 3.0, 0.4
    rate = 2.0 * np.sin(turn * STEP / 2.0) / STEP
    way = circle(radius, turn)
    speeds = np.linalg.norm(motion.velocities(way, STEP), axis=1)
    assert speeds == pytest.approx(radius * rate)
    pulls = np.linalg.norm(motion.accelerations(way, STEP), axis=1)
    assert pulls == pytest.approx(radius * rate**2)
    assert motion.jerk_rms(way, STEP) == pytest.approx(radius * rate**3)
    assert motion.course_change(way) == pytest.approx(turn * STEP * 199)
    headings = (turn * TIMES + np.pi / 2 + np.pi) % (2 * np.pi) - np.pi
    assert motion.heading_change(headings) == pytest.approx(turn * 20.0)
    effort = motion.effort(way, np.full(201, turn), STEP)
    assert effort == pytest.approx(199 * STEP * (radius * rate**2) ** 2)
    assert motion.sign_changes(np.full(201, turn)) == 0


def test_braking_on_a_line() -> None:
    """Speed 2 - t / 10 to rest at 20 s: constant deceleration, no jerk, no turn."""
    way = np.stack([2.0 * TIMES - 0.05 * TIMES**2, np.zeros(201)], axis=1)
    assert np.linalg.norm(motion.accelerations(way, STEP), axis=1) == pytest.approx(0.1)
    assert motion.jerk_rms(way, STEP) == pytest.approx(0.0, abs=1e-9)
    assert motion.effort(way, np.zeros(201), STEP) == pytest.approx(0.01 * 19.9)
    assert motion.course_change(way) == pytest.approx(0.0, abs=1e-7)
    # Below 0.01 m/s in the last step alone, below 0.04 m/s in the last four.
    assert motion.not_moving(way, np.zeros(201), STEP) == pytest.approx(0.1)
    assert motion.not_moving(way, np.full(201, 0.1), STEP) == 0.0
    frozen = motion.frozen_steps(way, np.array([25.0, 0.0]), 0.3, STEP)
    assert frozen.sum() == 4 and motion.longest_run(frozen) == 4
    assert not motion.frozen_steps(way, np.array([20.0, 0.0]), 0.3, STEP).any()


def test_a_swaying_yaw_rate() -> None:
    """sin(t) over 20 s has zeros at pi, ..., 6 pi; less than the dead band has no sign."""
    assert motion.sign_changes(np.sin(TIMES)) == 6
    assert motion.sign_changes(0.019 * np.sin(TIMES)) == 0
    assert motion.sign_changes(np.array([1.0, 0.0, 0.0, 1.0, -0.01, 1.0])) == 0
    yaw = np.cos(TIMES)  # alpha is that of the sampled rate
    rate = 2.0 * np.sin(STEP / 2.0) / STEP
    middle = 0.5 * (TIMES[1:] + TIMES[:-1])
    expected = STEP * np.sum((rate * np.sin(middle)) ** 2)
    assert motion.effort(np.zeros((201, 2)), yaw, STEP) == pytest.approx(expected)


def test_irregularity_is_the_angle_to_the_goal() -> None:
    goal = np.array([10.0, 0.0])
    straight = np.stack([0.4 * TIMES, np.zeros(201)], axis=1)
    unknown = np.full(201, np.nan)
    assert motion.irregularity(straight, unknown, goal) == pytest.approx(0.0, abs=1e-7)
    assert motion.irregularity(straight, np.full(201, 0.5), goal) == pytest.approx(0.5)
    # Round the goal: always across.
    assert motion.irregularity(circle(3.0, 0.4), unknown, np.zeros(2)) == pytest.approx(
        np.pi / 2 - 0.02
    )  # a chord begins half a step's angle inwards
    assert np.isnan(motion.irregularity(np.zeros((5, 2)), np.full(5, np.nan), goal))


def test_in_space_too() -> None:
    flat = circle(3.0, 0.4)
    rising = np.concatenate([flat, 0.3 * TIMES[:, None]], axis=1)
    assert motion.jerk_rms(rising, STEP) == pytest.approx(motion.jerk_rms(flat, STEP))
    assert motion.course_change(rising) < motion.course_change(flat)


def test_a_move_of_a_millimetre_has_a_direction() -> None:
    for length, turned in ((1.5e-3, np.pi), (0.9e-3, 0.0)):
        way = np.array([[0.0, 0.0], [1.0, 0.0], [1.0, length], [2.0, length]])
        assert motion.course_change(way) == pytest.approx(turned)


def test_longest_run_against_brute_force() -> None:
    rng = np.random.default_rng(2)
    for share in (0.0, 0.3, 0.8, 1.0):
        flags = rng.random(60) < share
        words = "".join("x" if flag else " " for flag in flags).split()
        assert motion.longest_run(flags) == max(map(len, words), default=0)


def test_instants_are_the_corners_of_the_motion() -> None:
    assert motion.uniform_times(np.arange(0.0, 3.01, 0.02), 3.0) == pytest.approx(
        np.arange(31) * 0.1
    )
    coarse = np.arange(0.0, 3.01, 0.25)
    assert motion.uniform_times(coarse, 3.0) == pytest.approx(coarse)
    assert motion.uniform_times(coarse, 1.1) == pytest.approx(coarse[:5])
    odd = 0.1 * np.arange(31) * (1.0 - 1e-9)
    assert motion.uniform_times(odd, odd[-1])[-1] <= odd[-1]


def arc_length(speeds: np.ndarray, step: float) -> float:
    """SPARC by its definition, with a dense Fourier sum instead of an FFT."""
    count = 2 ** (int(np.ceil(np.log2(len(speeds)))) + 4)
    frequencies = np.arange(count // 2 + 1) / (count * step)
    frequencies = frequencies[frequencies <= 10.0]
    moments = step * np.arange(len(speeds))
    spectrum = np.abs(np.exp(-2j * np.pi * np.outer(frequencies, moments)) @ speeds)
    spectrum /= spectrum[0]
    last = np.flatnonzero(spectrum >= 0.05)[-1]
    pieces = [
        np.hypot((frequencies[k + 1] - frequencies[k]) / frequencies[last],
                 spectrum[k + 1] - spectrum[k])
        for k in range(last)
    ]  # fmt: skip
    return -float(np.sum(pieces))


def test_spectral_arc_length_against_its_definition() -> None:
    rng = np.random.default_rng(5)
    share = np.linspace(0.0, 1.0, 101)
    smooth = 30 * share**2 * (1 - share) ** 2  # least jerk
    rough = smooth + 0.3 * rng.random(101)
    for speeds in (smooth, rough, np.ones(40)):
        expected = arc_length(speeds, 0.01)
        assert motion.spectral_arc_length(speeds, 0.01) == pytest.approx(expected, rel=1e-9)
        # Neither the scale of the speed nor that of time matters (below 10 Hz).
        assert motion.spectral_arc_length(7.0 * speeds, 0.01) == pytest.approx(expected)
    wide = motion.spectral_arc_length(smooth, 0.1)
    assert wide == pytest.approx(motion.spectral_arc_length(smooth, 0.01))
    # The movement of least jerk is known for about -1.4; two of them are less smooth.
    assert wide == pytest.approx(-1.4, abs=0.05)
    assert motion.spectral_arc_length(np.tile(smooth, 2), 0.01) < wide - 0.3


def test_nothing_to_measure_is_unknown() -> None:
    assert np.isnan(motion.spectral_arc_length(np.zeros(10), STEP))
    assert np.isnan(motion.spectral_arc_length(np.ones(1), STEP))
    assert np.isnan(motion.jerk_rms(np.zeros((3, 2)), STEP))
    assert motion.course_change(np.zeros((1, 2))) == 0.0
    assert motion.heading_change(np.zeros(1)) == 0.0


def test_a_heading_that_is_not_known_throughout_is_that_of_the_motion() -> None:
    way = np.array([[0.0, 0.0], [1.0, 0.0], [2.0, 0.0]])
    headings, goal = np.array([1.0, np.nan, 1.0]), np.array([9.0, 0.0])
    assert motion.irregularity(way, headings, goal) == 0.0
    assert motion.irregularity(way, np.ones(3), goal) == pytest.approx(1.0)


def test_thresholds_of_standing() -> None:
    """Slower than 1 cm/s and 0.02 rad/s at once; the sign of less than that is none."""
    way = 0.1 * np.array([[0.0, 0.0], [0.009, 0.0], [0.02, 0.0], [0.02, 0.0]])
    assert motion.not_moving(way, np.array([0.019, 0.0, 0.021, 0.0]), 0.1) == pytest.approx(0.1)
    assert motion.sign_changes(np.array([0.021, -0.019, 0.03, -0.021])) == 1


def test_who_is_slower_than_a_centimetre_a_second_and_turns_less_than_0_02_stands() -> None:
    places = np.cumsum([[0.0, 0.0], [0.0009, 0.0], [0.0, 0.0011], [0.0, 0.0], [0.0, 0.0]], axis=0)
    for rates, wanted in (([0.0] * 5, 3), ([0.019] * 5, 3), ([0.0, 0.0, 0.0, 0.021, 0.0], 2)):
        assert motion.not_moving(places, np.array(rates), STEP) == pytest.approx(wanted * STEP)
    turns = np.array([0.021, -0.019, -0.021, 0.019, -0.021, 0.021])
    assert motion.sign_changes(turns) == 2
