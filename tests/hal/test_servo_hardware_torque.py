"""Tests of single calls that enable, check and disable torque, and of goals without a new measurement."""

from collections.abc import Collection
from typing import Any

import numpy as np
import pytest

from drivers.servos import sts
from hal.hal_errors import ActivationError, LifecycleError
from hal.lifecycle import LifecycleState
from hal.servos.servo_setup import ServoSetup
from hal.types import FloatArray, JointCommand
from tests.hal.bench import IDS, JOINTS, PERIOD_S, Bench, at
from tests.hal.test_activation_checks import reset

WRITE, SYNC_WRITE = 0x03, 0x83


class Offsets:
    """Compensation that records which offsets the hardware restarts."""

    def __init__(self) -> None:
        self.offsets: FloatArray = np.zeros(len(JOINTS))
        self.restarted: list[Collection[str] | None] = []

    def restart(self, names: Collection[str] | None = None) -> None:
        self.restarted.append(names)

    def update(self, command: JointCommand, states: Any) -> None: ...


def drop(bench: Bench, *, goals_too: bool = False) -> None:
    """Let the servos ignore group writes, and single writes of goals if ``goals_too`` is true."""
    port = bench.port.port
    write = port.write

    def forward(data: bytes) -> None:
        if data[4] != SYNC_WRITE and not (goals_too and data[4] == WRITE and data[5] == 41):
            write(data)

    port.write = forward  # type: ignore[method-assign]


def goal_packets(bench: Bench) -> list[tuple[int, int]]:
    """Return the instruction and ID of each packet with goals."""
    return [(i.code, i.servo_id) for i in bench.port.sent if i.code in (WRITE, SYNC_WRITE) and i.parameters[0] == 41]


def test_undoing_an_activation_disables_only_the_torque_that_it_enabled() -> None:
    bench = Bench().configured()
    bench.servos.servo(1).memory.put(sts.torque_enable, 1)
    bench.servos.servo(1).memory.put(sts.goal_position, bench.measured(1))
    bench.hardware.activate()
    assert bench.torque() == list(IDS)
    assert bench.hardware.undo_activation() == []
    assert (bench.hardware.state, bench.torque()) == (LifecycleState.INACTIVE, [1])
    with pytest.raises(LifecycleError, match="undo the activation"):
        bench.hardware.undo_activation()


def test_the_hardware_holds_if_the_torque_of_any_servo_is_enabled() -> None:
    bench = Bench()
    with pytest.raises(LifecycleError, match="check the torque"):
        bench.hardware.holds()
    bench.configured()
    assert not bench.hardware.holds()
    bench.servos.servo(7).memory.put(sts.torque_enable, 1)
    assert bench.hardware.holds()


@pytest.mark.parametrize(("value", "drives"), [(0, False), (1, True), (2, True)])
def test_a_servo_in_damping_mode_drives_its_motor(value: int, drives: bool) -> None:
    bench = Bench().configured()
    bench.servos.servo(2).memory.put(sts.torque_enable, value)
    setup = ServoSetup(bench.hardware._opened("test"))
    assert [setup.drives(joint) for joint in JOINTS] == [False, drives, False]


def test_the_torque_of_configured_hardware_is_disabled_over_its_open_port() -> None:
    bench = Bench().active()
    opened = bench.opened
    assert bench.hardware.disable_torque() == []
    assert (bench.torque(), bench.opened) == ([], opened)


@pytest.mark.parametrize(
    ("call", "action"), [("ask_for_torque", "check the torque"), ("reactivate", "reactivate"), ("write", "write")]
)
def test_calls_for_active_hardware_are_refused_with_their_action(call: str, action: str) -> None:
    hardware = Bench().configured().hardware
    arguments = (JointCommand(at(0.0, 0.0, 0.01), PERIOD_S),) if call == "write" else ()
    with pytest.raises(LifecycleError, match=action):
        getattr(hardware, call)(*arguments)


def test_a_reactivation_keeps_the_offsets_of_other_joints() -> None:
    bench, offsets = Bench(), Offsets()
    bench.hardware.compensation = offsets  # type: ignore[assignment]
    bench.active().cycle(at(0.0, 0.0, 0.01))
    reset(bench)
    assert bench.hardware.reactivate() == {"elbow"}
    assert offsets.restarted == [None, {"elbow"}]


def test_an_old_measurement_does_not_hold_a_goal_back() -> None:
    """Only new measurements can show that a joint is blocked."""
    bench = Bench().active()
    bench.cycle(at(0.0, 0.0, 0.01))
    bench.place((1100, 2000, 1500))
    for _ in range(2):  # A second reading confirms the first.
        bench.wait()
    for _ in range(4):
        bench.hardware.write(JointCommand(at(0.0, 0.0, 0.01), PERIOD_S))
    assert bench.held(1, sts.goal_position) == 2048


def test_servos_that_ignore_group_writes_receive_single_goals() -> None:
    bench = Bench().configured()
    drop(bench)
    bench.hardware.activate()
    bench.port.sent.clear()
    bench.cycle(at(0.1, 0.1, 0.01))
    assert sorted(goal_packets(bench)) == [(WRITE, i) for i in IDS]


def test_an_activation_whose_goals_never_arrive_keeps_group_writes() -> None:
    bench = Bench().configured()
    drop(bench, goals_too=True)
    bench.place((2000, 2000, 1500))
    lost = r"shoulder \(servo 1\) has goal 0 instead of 2000\. Check the cable and the supply"
    with pytest.raises(ActivationError, match=lost):
        bench.hardware.activate()
    assert bench.torque() == []
    del bench.port.port.write
    bench.hardware.activate()
    bench.port.sent.clear()
    bench.cycle(at(0.0, 0.0, 0.01))
    assert goal_packets(bench) == [(SYNC_WRITE, 0xFE)]
