"""The set-up with gear tests rejects servos with a wrong gear."""

from collections.abc import Callable
from dataclasses import dataclass, field
from typing import Any

import pytest

from commissioning.set_up.flow import SetUp, SetUpTask
from commissioning.set_up.only_one import ServoPlace
from commissioning.slow_arm import StoppedError
from drivers.bus.bus import Bus
from drivers.servos import sts
from servoloop.commands.set_up import _run
from servoloop.stack.processes import Interrupted
from sim_backend.box import VirtualBox
from sim_backend.buses.port import VirtualPort
from sim_backend.clock import SimulatedClock
from sim_backend.servos.sts.servo import VirtualServo
from tests.commissioning.box import GRIPPER

LIFT, JAW = 0, 1
PLACES = [ServoPlace("lift", 2, sts.STS3215_C001), ServoPlace("jaw", 3, sts.STS3215_C046, GRIPPER)]
NAMES = [place.joint for place in PLACES]


@dataclass
class Table:
    """Two loose servos of a leader, and hands that connect the requested servo or the servo that ``instead``
    returns."""

    instead: Callable[[SetUpTask], int | None] = lambda task: None
    asked: list[SetUpTask] = field(default_factory=list)
    said: list[str] = field(default_factory=list)

    def __post_init__(self) -> None:
        self.clock = SimulatedClock(10.0)
        self.box = VirtualBox([place.model for place in PLACES])
        self.bus = Bus(VirtualPort(self.box.line, self.clock), self.clock)

    def servo(self, number: int) -> VirtualServo:
        servo = self.box.servos[number]
        assert isinstance(servo, VirtualServo)
        return servo

    def say(self, text: str) -> None:
        self.said.append(text)

    def connect(self, task: SetUpTask) -> None:
        self.asked.append(task)
        other = self.instead(task)
        right = range(len(PLACES)) if task.kind == "chain" else (NAMES.index(task.joint),)
        self.box.connect(*(right if other is None else (other,)))
        self.clock.sleep_until(self.clock.now() + 1.0)

    def set_up(self, *, turn: bool = True, stopped: Callable[[], bool] = lambda: False) -> SetUp:
        return SetUp(self.bus, self.clock, PLACES, self, turn=turn, stopped=stopped)


def the_wrong_one_first(task: SetUpTask) -> int | None:
    return LIFT if task.joint == "jaw" and not task.problem else None


def test_a_servo_with_a_wrong_gear_is_rejected() -> None:
    table = Table(the_wrong_one_first)
    held: list[tuple[int, ...]] = []

    def look(task: SetUpTask) -> int | None:
        if task.problem:
            memory = table.servo(LIFT).memory
            held.append(tuple(memory.get(register) for register in (sts.servo_id, sts.position_p, sts.max_torque)))
        return the_wrong_one_first(task)

    table.instead = look
    audit = table.set_up().run()
    (problem,) = (task.problem for task in table.asked if task.problem)
    assert "servo 1 has the wrong gear for jaw" in problem
    assert (
        "an sts3215_c046 (7.4 V, gear 1:147) needs 0.58 V, so it is probably an sts3215_c001 (7.4 V, gear 1:345)"
        in problem
    )
    assert "You can still use this servo for another joint" in problem
    assert held == [(1, 32, 1000)], "as it was delivered"
    assert [(one.joint, one.gear and one.gear.verdict) for one in audit] == [("lift", "fits"), ("jaw", "fits")]
    assert table.box.ids() == [2, 3]
    for number, place in enumerate(PLACES):
        table.servo(number).power_cycle()
        assert {r: table.servo(number).memory.get(r) for r in place.wanted()} == place.wanted()
    assert [("Its horn will turn" in task.text) for task in table.asked] == [True, True, True, False]
    assert not any("unknown" in text for text in table.said)


def test_a_set_up_servo_with_a_wrong_gear_can_be_reset() -> None:
    table = Table(the_wrong_one_first)
    table.servo(LIFT).memory.save(sts.servo_id, 3)

    def end(task: SetUpTask) -> int | None:
        if task.problem:
            raise KeyboardInterrupt
        return the_wrong_one_first(task)

    table.instead = end
    with pytest.raises(KeyboardInterrupt):
        table.set_up().run()
    assert "reset it with 'servoloop factory-reset 3 --port " in table.asked[-1].problem
    assert "and 'servoloop set-id 3 1 --port " in table.asked[-1].problem


def test_a_loaded_horn_is_reported_and_the_servo_is_set_up() -> None:
    table = Table()
    plant: Any = table.box.line.rig.plant
    plant.load_nm[JAW] = 0.3
    audit = table.set_up().run()
    assert [one.gear and one.gear.verdict for one in audit] == ["fits", "not sure"]
    assert "jaw: its gear could not be determined (something pulls at its horn)" in table.said
    assert table.said[-1].startswith("the gears of jaw are unknown")
    assert table.box.ids() == [2, 3]


def test_without_the_gear_test_torque_stays_off_and_unknown_gears_are_reported() -> None:
    table = Table(the_wrong_one_first)
    table.instead = lambda task: None
    audit = table.set_up(turn=False).run()
    assert [one.gear for one in audit] == [None, None]
    assert table.said[-1].startswith("the gears of lift, jaw are unknown")
    assert not any("horn" in task.text for task in table.asked)
    assert [table.servo(number).memory.get(sts.goal_position) for number in (LIFT, JAW)] == [0, 0], "never had a goal"


def test_a_signal_during_the_gear_test_releases_the_servo() -> None:
    table = Table()

    def stopped() -> bool:
        return table.servo(JAW).memory.get(sts.torque_enable) == 1 and table.clock.now() > 18.0

    with pytest.raises(
        Interrupted, match=r"interrupted; no servo is set up yet\. The torque of the servos is unchanged"
    ) as end:
        _run(table.set_up(stopped=stopped))
    assert isinstance(end.value.__context__, StoppedError)
    assert table.servo(JAW).memory.get(sts.torque_enable) == 0
    assert table.box.ids() == [1, 1]


@pytest.mark.parametrize("signal", [False, True], ids=["at the next task", "during the gear test"])
def test_an_interruption_names_a_servo_that_may_have_kept_its_torque(signal: bool) -> None:
    """The servo falls silent while its horn turns."""
    table = Table()
    memory, silent = table.servo(JAW).memory, list[bool]()

    def reaches(servo_id: int) -> bool:
        if memory.get(sts.torque_enable) == 1 and table.clock.now() > 18.0:
            silent.append(True)
        return not silent

    def end(task: SetUpTask) -> None:
        if task.problem:
            raise Interrupted("interrupted")

    table.box.line.faults.on_instruction.append(reaches)
    table.instead = end
    told = (
        r"^interrupted; no servo is set up yet\. The torque of servo 1 may still be on: unplug the servo or switch its "
        r"supply off\. Run the same command again"
    )
    with pytest.raises(Interrupted, match=told):
        _run(table.set_up(stopped=lambda: signal and bool(silent)))
    assert memory.get(sts.torque_enable) == 1


def test_a_servo_that_keeps_its_torque_is_forgotten_once_a_servo_was_turned_and_released() -> None:
    table = Table()
    memory, tasks = table.servo(JAW).memory, list[SetUpTask]()

    def connect(task: SetUpTask) -> None:
        tasks.append(task)
        if len(tasks) == 2:
            table.servo(JAW).power_cycle()
        if len(tasks) == 3:
            raise Interrupted("interrupted")

    def reaches(servo_id: int) -> bool:
        return len(tasks) > 1 or memory.get(sts.torque_enable) == 0 or table.clock.now() < 18.0

    table.box.line.faults.on_instruction.append(reaches)
    table.instead = connect
    with pytest.raises(Interrupted, match=r"set up so far: jaw\. The torque of the servos is unchanged"):
        _run(table.set_up())
    assert "servo 1 may still be on" in tasks[1].problem
