"""Test the final state of the arm, even if steps of the shutdown fail."""

from collections.abc import Callable
from typing import Any

import numpy as np
import pytest

from controller.shutdown import shut_down
from drivers.driver_errors import PortLost
from hal.lifecycle import LifecycleState
from tests.controller.bench import ARM_LIMITS, PERIOD_S, Bench, to

PARK = {"shoulder": -0.5, "elbow": 0.5}
SCALE = 0.25


def moving_bench() -> Bench:
    bench = Bench().up()
    bench.send(to(1.5, 0.0))
    bench.cycle(12)
    assert bench.velocity[0] > 1.0
    return bench


def last_calls(bench: Bench) -> list[str]:
    return [call for call in bench.hardware.calls if call not in ("read", "write")]


def failing_with(error: Exception) -> Callable[..., Any]:
    def fail(*_: object) -> None:
        raise error

    return fail


@pytest.mark.parametrize("relax", [False, True])
@pytest.mark.parametrize("park", [None, PARK], ids=["no park pose", "park pose"])
@pytest.mark.parametrize("hurry", [False, True])
def test_it_stops_parks_where_asked_and_ends(relax: bool, park: dict[str, float] | None, hurry: bool) -> None:
    bench = moving_bench()
    handle = bench.send(to(-1.0, 0.0))
    cycles = len(bench.path())
    assert shut_down(bench.loop, relax, park, SCALE, lambda: hurry) == []
    assert last_calls(bench) == ["relax" if relax else "hold", "cleanup"]
    assert bench.hardware.state is LifecycleState.UNCONFIGURED
    assert handle.error_text == "Current goal cancelled during deactivate transition."
    path = bench.path()[:, :2]
    parked = relax and park is not None and not hurry
    assert (np.abs(path[-1] - [-0.5, 0.5]).max() < 1e-6) == parked
    velocity = np.diff(path, axis=0) / PERIOD_S
    change = np.abs(np.diff(velocity, axis=0)).max()
    assert change <= ARM_LIMITS.acceleration * PERIOD_S * 1.2  # the curve of the motion between two cycles
    assert np.abs(velocity[-1]).max() < 0.05 + 0.5 * parked
    if parked:
        stopped = cycles + int(np.argmin(np.abs(velocity[cycles:, 0])))
        assert np.abs(velocity[stopped:]).max() <= SCALE * ARM_LIMITS.velocity + 1e-9


def test_parking_keeps_the_rate_of_the_loop() -> None:
    bench = moving_bench()
    begin_s, written = bench.clock.now(), len(bench.path())
    shut_down(bench.loop, True, PARK, SCALE)
    count = len(bench.path()) - written
    assert bench.clock.now() - begin_s == pytest.approx(count * PERIOD_S)


def test_a_second_signal_during_parking_disables_the_torque_at_once() -> None:
    bench = moving_bench()
    begin_s = bench.clock.now()
    assert shut_down(bench.loop, True, PARK, SCALE, lambda: bench.clock.now() > begin_s + 1.0) == []
    assert last_calls(bench) == ["relax", "cleanup"]
    assert bench.clock.now() < begin_s + 1.0 + 2 * PERIOD_S
    assert np.abs(bench.path()[-1][:2] - [-0.5, 0.5]).max() > 0.1


@pytest.mark.parametrize("relax", [False, True])
@pytest.mark.parametrize("where", ["update", "deactivate", "both"])
def test_after_a_controllers_bug_it_still_stops_and_parks(where: str, relax: bool) -> None:
    bench = moving_bench()
    error = RuntimeError("a controller's bug")
    if where in ("update", "both"):
        bench.arm.update = failing_with(error)  # type: ignore[method-assign]
        bench.cycle()  # the manager deactivates the controller
    if where in ("deactivate", "both"):
        bench.arm.deactivate = failing_with(error)  # type: ignore[method-assign]
    problems = shut_down(bench.loop, relax, PARK, SCALE)
    expected = ["could not deactivate the controllers: a controller's bug"] if where == "deactivate" else []
    assert problems == expected
    assert last_calls(bench) == ["relax" if relax else "hold", "cleanup"]
    assert (np.abs(bench.path()[-1][:2] - [-0.5, 0.5]).max() < 1e-6) == relax
    velocity = np.diff(bench.path()[:, :2], axis=0) / PERIOD_S
    assert np.abs(np.diff(velocity, axis=0)).max() <= ARM_LIMITS.acceleration * PERIOD_S * 1.2


@pytest.mark.parametrize("relax", [False, True], ids=["hold", "relax"])
@pytest.mark.parametrize(
    ("failing", "problems"),
    [
        (("read",), ["stop the motion", "park"]),
        (("write",), ["stop the motion", "park"]),
        (("relax", "hold"), ["switch off"]),
        (("cleanup",), ["release the port"]),
        (
            ("read", "write", "relax", "hold", "cleanup"),
            ["stop the motion", "park", "switch off", "release the port"],
        ),
    ],
    ids=["read", "write", "switching off", "cleanup", "port lost"],
)
def test_every_later_step_is_tried(failing: tuple[str, ...], problems: list[str], relax: bool) -> None:
    bench = moving_bench()
    bench.hardware.failing = dict.fromkeys(failing, PortLost("the port was unplugged"))
    found = shut_down(bench.loop, relax, PARK, SCALE)
    wanted = [problem for problem in problems if relax or problem != "park"]
    assert found == [f"could not {problem}: the port was unplugged" for problem in wanted]
    assert last_calls(bench) == ["relax" if relax else "hold", "cleanup"]
    assert not bench.arm.running


def test_an_unreachable_park_pose_is_reported_and_the_torque_disabled() -> None:
    bench = moving_bench()
    (problem,) = shut_down(bench.loop, True, {"shoulder": float("nan")}, SCALE)
    assert problem.startswith("could not park: the park pose cannot be reached: ")
    assert last_calls(bench) == ["relax", "cleanup"]


def test_an_arm_that_was_never_active_is_only_closed() -> None:
    bench = Bench()
    bench.hardware.configure()
    assert shut_down(bench.loop, True, PARK, SCALE) == []
    assert bench.hardware.calls == ["cleanup"]


def test_problems_during_deactivation_are_returned() -> None:
    bench = moving_bench()
    bench.hardware.deactivate = lambda relax: ["servo 3: does not respond"]  # type: ignore[method-assign]
    assert shut_down(bench.loop, True, PARK, SCALE) == ["servo 3: does not respond"]


def final_state(bench: Bench, caplog: pytest.LogCaptureFixture, relax: bool = False, hurry: bool = False) -> str:
    """Shut down and return the last line of the log."""
    caplog.set_level("INFO")
    shut_down(bench.loop, relax, PARK, SCALE, lambda: hurry)
    return caplog.messages[-1]


@pytest.mark.parametrize(
    ("relax", "hurry", "expected"),
    [
        (False, False, "scripted holds its position with torque enabled (on_exit: hold)"),
        (True, False, "scripted is in its park pose, and its torque is off"),
        (True, True, "scripted is where it stopped, and its torque is off"),
    ],
)
def test_the_log_ends_with_the_final_state_of_the_arm(
    caplog: pytest.LogCaptureFixture, relax: bool, hurry: bool, expected: str
) -> None:
    assert final_state(moving_bench(), caplog, relax, hurry) == expected


def test_an_arm_that_cannot_be_parked_is_not_logged_as_parked(caplog: pytest.LogCaptureFixture) -> None:
    bench = moving_bench()
    bench.hardware.failing = {"write": PortLost("the port was unplugged")}
    assert final_state(bench, caplog, relax=True) == "scripted is where it stopped, and its torque is off"


@pytest.mark.parametrize("relax", [False, True])
def test_torque_that_may_still_be_on_is_logged(caplog: pytest.LogCaptureFixture, relax: bool) -> None:
    bench = moving_bench()
    bench.hardware.deactivate = lambda relax: ["servo 3: does not respond"]  # type: ignore[method-assign]
    assert final_state(bench, caplog, relax) == "the torque of scripted may still be enabled: servo 3: does not respond"


def test_a_joint_that_lost_its_torque_is_not_logged_as_holding(caplog: pytest.LogCaptureFixture) -> None:
    bench = moving_bench()
    bench.hardware.without_torque = frozenset({"elbow"})  # type: ignore[attr-defined]
    bench.hardware.reactivate = frozenset  # type: ignore[attr-defined]
    expected = "scripted holds its position with torque enabled (on_exit: hold), except elbow, whose torque was off"
    assert final_state(bench, caplog) == expected


def test_a_joint_that_lost_its_torque_just_now_is_not_logged_as_holding(caplog: pytest.LogCaptureFixture) -> None:
    bench = moving_bench()
    hardware: Any = bench.hardware
    hardware.without_torque, hardware.reactivate = frozenset(), frozenset

    def ask_for_torque() -> frozenset[str]:
        hardware.without_torque = frozenset({"elbow"})
        return frozenset()

    hardware.ask_for_torque = ask_for_torque
    expected = "scripted holds its position with torque enabled (on_exit: hold), except elbow, whose torque was off"
    assert final_state(bench, caplog) == expected


def test_an_arm_that_was_never_active_is_logged_as_unchanged(caplog: pytest.LogCaptureFixture) -> None:
    bench = Bench()
    bench.hardware.configure()
    assert final_state(bench, caplog, relax=True) == "scripted was not active: its torque is unchanged"


@pytest.mark.parametrize(
    ("relax", "expected"),
    [
        (False, "scripted was lost: its servos hold their last goal if their torque is enabled"),
        (True, "the torque of scripted may still be enabled: could not switch off: the port was unplugged"),
    ],
)
def test_a_lost_arm_is_logged_as_lost(caplog: pytest.LogCaptureFixture, relax: bool, expected: str) -> None:
    bench = moving_bench()
    bench.hardware.failing = dict.fromkeys(("read", "write", "relax"), PortLost("the port was unplugged"))
    with pytest.raises(PortLost):
        bench.cycle()
    assert final_state(bench, caplog, relax) == expected
