"""Following errors at the cycles and between them."""

import numpy as np
import pytest

from servoloop.recording.following_error import UNKNOWN, between_cycles, following_error, reference_at, worst


def test_the_largest_error_counts_always_and_the_rms_only_while_moving() -> None:
    error = np.array([[0.3, 0.0], [0.1, 0.02], [-0.1, -0.02]])
    velocity = np.array([[0.0, 0.0], [1.0, 2.0], [1.0, 2.0]])
    found = following_error(np.arange(3.0), error, velocity)
    assert found.largest_rad == (0.3, 0.02)
    assert found.rms_moving_rad == (0.1, 0.02)
    assert found.fastest == 1


def test_the_error_at_rest_counts_from_half_a_second_after_the_motion() -> None:
    times = np.arange(0.0, 2.0, 0.1)
    velocity = np.where((times > 0.55) & (times < 1.05), 1.0, 0.0)[:, None] * [1.0, 0.0]
    error = np.array([[0.01 * (len(times) - i), 0.001 * i] for i in range(len(times))])
    found = following_error(times, error, velocity)
    assert found.at_rest_rad == (0.15, 0.019)  # the first value is measured before the motion, at 0.5 s
    assert following_error(times[:4], error[:4], velocity[:4]).at_rest_rad == (0.0, 0.0)


def test_without_measurements_there_are_no_figures() -> None:
    assert following_error(np.empty(0), np.empty((0, 6)), np.empty((0, 6))) is UNKNOWN
    assert UNKNOWN.as_dict([])["largest_rad"] is None
    assert worst([UNKNOWN]) is UNKNOWN


def test_between_the_cycles_the_reference_is_the_cubic_through_positions_and_velocities() -> None:
    cycles = np.arange(0.0, 1.01, 0.05)
    times = np.linspace(0.0, 1.0, 333)

    def motion(t: np.ndarray) -> np.ndarray:
        return (t**3 - t)[:, None]

    def speed(t: np.ndarray) -> np.ndarray:
        return (3 * t**2 - 1)[:, None]

    position, velocity = reference_at(times, cycles, motion(cycles), speed(cycles))
    assert position == pytest.approx(motion(times))
    assert velocity == pytest.approx(speed(times))


def test_a_jump_of_a_servo_is_only_visible_between_the_cycles() -> None:
    cycles = np.arange(20) * 0.05
    reference, velocity = cycles[:, None], np.ones((20, 1))
    ticks = np.arange(191)
    leaping = np.ceil(ticks / 10) * 0.05  # equal to the reference at each cycle, and ahead of it between cycles
    at = following_error(cycles, reference - leaping[::10, None], velocity)
    between = between_cycles(list(ticks * 0.005), [[p] for p in leaping], cycles, reference, velocity)
    assert at.largest_rad == (0.0,)
    assert between.largest_rad[0] == pytest.approx(0.045)


def test_the_worst_of_several_runs_is_taken_joint_by_joint() -> None:
    velocity = np.ones((1, 2))
    runs = [following_error(np.zeros(1), np.array([e]), velocity) for e in ([0.1, 0.2], [0.3, 0.1])]
    assert worst(runs).largest_rad == (0.3, 0.2)
