"""Test the commands of a hand, and when the hand has settled."""

import numpy as np
import pytest

from controller.forward.forward_command_controller import ForwardCommandController
from hal.types import JointState
from tests.controller.bench import HAND, HAND_LIMITS, PERIOD_S, Bench

NAN, INF = float("nan"), float("inf")


def hand_commands(bench: Bench) -> list[float]:
    return [float(value) for value in bench.path()[:, 2]]


@pytest.mark.parametrize(
    ("values", "reason"),
    [
        (
            [0.01, 0.02],
            "command size (2) does not match number of interfaces (1): the command is dropped. "
            "Send one value for each of finger",
        ),
        ([NAN], "Non-finite value received. Dropping message"),
        ([INF], "Non-finite value received. Dropping message"),
        ([-INF], "Non-finite value received. Dropping message"),
        ([], None),
    ],
    ids=["wrong length", "NaN", "inf", "-inf", "empty"],
)
def test_an_invalid_command_is_dropped_and_the_hand_continues(values: list[float], reason: str | None) -> None:
    bench = Bench().up()
    bench.hand.submit([0.002])
    bench.cycle(2)
    assert bench.hand.submit(values) == reason
    bench.cycle(2)
    assert hand_commands(bench) == pytest.approx([0.002] * 4)
    assert bench.hand.submit([0.004]) is None
    bench.cycle()
    assert hand_commands(bench)[-1] == pytest.approx(0.004)


@pytest.mark.parametrize(("wanted", "expected"), [(0.5, 0.05), (-0.01, 0.0), (0.05, 0.05)])
def test_a_command_beyond_the_limits_goes_to_the_limit(
    wanted: float, expected: float, caplog: pytest.LogCaptureFixture
) -> None:
    bench = Bench().up()
    assert bench.hand.submit([wanted]) is None
    bench.cycle(20)
    assert hand_commands(bench)[-1] == pytest.approx(expected)
    assert ("outside the limits" in caplog.text) == (wanted != expected)


def test_the_hand_holds_its_position_until_the_first_command() -> None:
    bench = Bench()
    bench.hardware._position = np.array([0.0, 0.0, 0.03])
    bench.up().cycle(3)
    assert hand_commands(bench) == pytest.approx([0.03] * 3)


def test_the_last_command_is_repeated_in_every_cycle() -> None:
    bench = Bench().up()
    bench.hand.submit([0.002])
    bench.cycle(5)
    assert hand_commands(bench) == pytest.approx([0.002] * 5)


def test_the_latest_of_several_commands_in_a_cycle_is_used() -> None:
    bench = Bench().up()
    for value in (0.001, 0.0015, 0.002):
        bench.hand.submit([value])
    bench.cycle()
    assert hand_commands(bench) == pytest.approx([0.002])


def test_a_command_from_before_the_activation_is_ignored() -> None:
    bench = Bench()
    bench.hand.submit([0.05])
    bench.up().cycle(3)
    assert hand_commands(bench) == [0.0] * 3


# Settling


def slow_bench(way_per_cycle: float = 0.004) -> Bench:
    bench = Bench().up()
    bench.hardware.slow = {HAND: way_per_cycle}
    bench.cycle()
    return bench


def test_the_hand_is_unsettled_as_soon_as_a_command_is_submitted() -> None:
    bench = slow_bench()
    assert bench.hand.settled()
    bench.hand.submit([0.05])
    assert not bench.hand.settled()
    bench.cycle()
    assert not bench.hand.settled()


def test_the_hand_is_settled_on_arrival() -> None:
    bench = slow_bench()
    bench.hand.submit([0.05])
    bench.cycles_until(bench.hand.settled)
    assert bench.hardware.read().position[2] == pytest.approx(0.05, abs=0.02 * HAND_LIMITS.upper + 1e-9)


def test_the_hand_is_settled_when_its_fingers_stall_but_not_before_they_can_move() -> None:
    bench = slow_bench()
    bench.hardware.stuck = {HAND}
    bench.hand.submit([0.05])
    cycles = bench.cycles_until(bench.hand.settled)
    assert 0.1 < cycles * PERIOD_S <= 0.2


def test_releasing_fingers_are_not_settled_until_the_command_reaches_them() -> None:
    """The command first moves from inside the object back to the fingers, which are at rest until then."""
    bench = slow_bench()
    bench.hardware.objects = {HAND: 0.02}
    bench.hand.submit([0.05])
    bench.cycles_until(bench.hand.settled)
    bench.cycle(10)
    assert bench.loop.command[2] == 0.05 and bench.hardware.read().position[2] == 0.02
    bench.hand.submit([0.0])
    bench.cycles_until(bench.hand.settled)
    assert bench.hardware.read().position[2] == pytest.approx(0.0, abs=0.02 * HAND_LIMITS.upper + 1e-9)


def test_fingers_that_stall_briefly_and_slip_are_not_settled() -> None:
    bench = slow_bench()
    bench.hand.submit([0.05])
    for _ in range(3):
        bench.hardware.stuck = {HAND}
        bench.cycle()
        assert not bench.hand.settled()
        bench.hardware.stuck = set()
        bench.cycle(2)
        assert not bench.hand.settled()


def test_a_repeated_command_does_not_unsettle_the_hand() -> None:
    bench = slow_bench()
    bench.hand.submit([0.05])
    bench.cycles_until(bench.hand.settled)
    bench.hand.submit([0.05])
    bench.cycle()
    assert bench.hand.settled()


def test_an_unmeasured_hand_never_settles() -> None:
    bench = Bench().up()
    bench.hand.submit([0.05])
    for _ in range(20):
        bench.hardware._position = bench.hardware._velocity = np.full(3, np.nan)
        bench.hand.update(bench.hardware.read(), bench.clock.now(), PERIOD_S)
        assert not bench.hand.settled()


@pytest.mark.parametrize("period_s", [0.001, 0.01, 0.05, 0.1, 0.5, 1.0])
def test_a_measurement_from_before_the_command_never_settles_the_hand(period_s: float) -> None:
    hand = ForwardCommandController("hand", (HAND,), (HAND_LIMITS,), (HAND,))
    standing = JointState(0.0, np.zeros(1), np.zeros(1), np.zeros(1))
    hand.activate(standing, np.zeros(1))
    hand.submit([0.05])
    hand.update(standing, 0.0, period_s)
    assert not hand.settled()
