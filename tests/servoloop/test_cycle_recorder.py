"""Recordings of cycles: they contain all bytes on the bus until the end of the program, with readable packets."""

import pytest

from drivers.protocol import v1, v2
from drivers.servos.sts import STS3215
from drivers.servos.x import XL430_W250
from hal.joint import Joint
from hal.types import JointLimits
from servoloop.campaign.campaign import run_schedule_of
from servoloop.simulation.cycle_recorder import CycleRecorder
from servoloop.simulation.faulty_stack import FaultyStack
from servoloop.simulation.schedule import Schedule
from servoloop.simulation.trace_file import PacketText
from sim_backend.faults.text import parse
from sim_backend.packets import dynamixel as dynamixel_wire
from sim_backend.packets import sts as sts_wire

LIMITS = JointLimits(-1.0, 1.0, 1.0, 1.0, 1.0)
TEXT_1 = [Joint("a", 1, STS3215, LIMITS), Joint("b", 2, STS3215, LIMITS)]
TEXT_2 = [Joint("a", 1, XL430_W250, LIMITS)]


def test_a_recording_contains_every_byte_until_the_end_of_the_program() -> None:
    stacks: list[FaultyStack] = []
    recorders: list[CycleRecorder] = []

    def prepare(stack: FaultyStack) -> None:
        stacks.append(stack)
        recorders.append(CycleRecorder(stack))

    faults = (parse("noise at=0.2s for=0.3s"), parse("silent id=2 at=0.3s for=0.4s"))
    run_schedule_of(Schedule(seconds=1.0, faults=faults), prepare)
    packets = [packet for cycle in recorders[0].recording.cycles for packet in cycle.packets]
    assert [p.stamp_s for p in packets] == sorted(p.stamp_s for p in packets)
    for sent, log in ((True, stacks[0].port.sent), (False, stacks[0].port.received)):
        assert b"".join(p.data for p in packets if p.sent is sent) == b"".join(data for _, data in log)
    assert recorders[0].recording.cycles[-1].time_s > 1.0


def test_a_part_of_a_recording_includes_time_before_and_cycles_after_the_event() -> None:
    recorders: list[CycleRecorder] = []
    run_schedule_of(Schedule(seconds=1.0), lambda stack: recorders.append(CycleRecorder(stack)))
    whole = recorders[0].recording
    moment_s = whole.cycles[12].time_s
    part = whole.around(moment_s, 0.2, 3)
    assert part.cycles == whole.cycles[8:16]
    assert whole.around(99.0, 0.2, 3).cycles == ()
    assert whole.around(-1.0, 0.2, 3).cycles == whole.cycles[:3]


@pytest.mark.parametrize(
    ("data", "text"),
    [
        (v1.packet(1, v1.WRITE, bytes((40, 1))), "WRITE torque_enable 1=01"),
        (v1.packet(2, v1.READ, bytes((56, 2))), "READ present_position[2] 2"),
        (v1.sync_read((1, 2), 56, 8), "SYNC_READ present_position[8] 1 2"),
        (v1.sync_write(42, 2, bytes((1, 0, 8, 2, 1, 8))), "SYNC_WRITE goal_position 1=0008 2=0108"),
        (v1.packet(1, v1.PING, b""), "PING 1"),
        (v1.packet(1, 0x77, b"\x01"), "0x77 1 01"),
        (b"\xff\xff\x01", "ff ff 01"),
    ],
)
def test_instructions_have_the_names_of_registers(data: bytes, text: str) -> None:
    assert PacketText(TEXT_1).sent(data) == text


def test_instructions_of_dynamixel_2_have_the_names_of_registers() -> None:
    goals = v2.sync_write(116, 4, b"\x01\x00\x08\x00\x00")
    assert PacketText(TEXT_2).sent(goals) == "SYNC_WRITE goal_position 1=00080000"
    assert PacketText(TEXT_2).sent(v2.sync_read((1,), 132, 4)) == "SYNC_READ present_position[4] 1"


def test_replies_are_shown_by_servo_and_other_bytes_one_by_one() -> None:
    reply, text = sts_wire.status_packet(2, 0x20, b"\x00\x08"), PacketText(TEXT_1)
    assert text.received(sts_wire.status_packet(1, 0, b"\x01\x08") + reply) == "1: 0108; 2: error 20 0008"
    assert text.received(b"\x55" + reply) == f"2: error 20 0008; 55 {reply.hex(' ')}"
    broken = reply[:-1] + bytes((reply[-1] ^ 1,))
    assert text.received(broken) == f"broken reply of 2; {broken.hex(' ')}"
    assert text.received(reply[:4]) == reply[:4].hex(" ")
    assert text.received(reply[4:]) == "2: error 20 0008"
    assert PacketText(TEXT_2).received(dynamixel_wire.status_packet(1, 0, b"\x00\x08\x00\x00")) == "1: 00080000"
