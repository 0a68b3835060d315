"""The servos for the benchmark of ``servoloop up`` store what the stack writes, because activation reads it back."""

from benchmarks.processes.stack_rates import StoringServos
from drivers.protocol import v1
from drivers.servos import sts


def test_goals_of_a_group_write_are_stored() -> None:
    servos, register = StoringServos([1, 2]), sts.goal_position
    read = v1.packet(2, v1.READ, v1.span(register.address, register.size))
    assert servos.answer(read)[5:7] == bytes(2)
    for goal in (b"\x34\x02", b"\x35\x02"):
        servos.answer(v1.sync_write(register.address, 2, b"\x01\x00\x08\x02" + goal))
        assert servos.answer(read)[5:7] == goal


def test_a_broadcast_is_stored_by_every_servo() -> None:
    servos, register = StoringServos([1, 2]), sts.torque_enable
    servos.answer(v1.packet(v1.BROADCAST_ID, v1.WRITE, bytes((register.address, 1))))
    for servo_id in (1, 2):
        assert servos.answer(v1.packet(servo_id, v1.READ, v1.span(register.address, 1)))[5:6] == b"\x01"
