"""Servos on the virtual wire: order and time of their replies, and effects of faults."""

import numpy as np
import pytest

from drivers.servos import sts
from sim_backend.buses.feetech import VirtualBus
from sim_backend.line.line import DelayedReply
from sim_backend.line.rig import Rig
from sim_backend.mechanics.plant import BenchPlant, Coupling, JointArrays, WorldPlant
from sim_backend.packets.sts import Code, checksum, status_packet
from sim_backend.servos.sts.firmware import StsVariant
from sim_backend.servos.sts.servo import VirtualServo

BYTE_S = 1e-5
DELAY_S = BYTE_S
"""Time without traffic after which a servo answers."""


def packet(servo_id: int, code: int, parameters: bytes = b"") -> bytes:
    body = bytes((servo_id, len(parameters) + 2, code)) + parameters
    return b"\xff\xff" + body + bytes((checksum(body),))


def bus_of(*servo_ids: int, paced: bool = True) -> VirtualBus:
    return VirtualBus.of(BenchPlant(servo_ids), paced=paced)


def ids(replies: list[DelayedReply]) -> list[int]:
    return [reply.data[2] for reply in replies]


READ_POSITIONS = packet(0xFE, Code.SYNC_READ, b"\x38\x02\x03\x01\x02")


def test_a_reply_takes_time_on_the_wire() -> None:
    bus = bus_of(1)
    (reply,) = bus.receive(packet(1, Code.PING), 10.0)
    assert reply.data == status_packet(1, 0)
    assert reply.due_s == pytest.approx(10.0 + 12 * BYTE_S + DELAY_S)


def test_unpaced_replies_arrive_at_once() -> None:
    bus = bus_of(1, paced=False)
    assert [reply.due_s for reply in bus.receive(packet(1, Code.PING), 10.0)] == [10.0]


def test_the_return_delay_is_in_units_of_two_microseconds() -> None:
    bus = bus_of(1)
    bus.servo(1).write(sts.return_delay.address, b"\xfa")
    (reply,) = bus.receive(packet(1, Code.PING), 0.0)
    assert reply.due_s == pytest.approx(12 * BYTE_S + DELAY_S + 500e-6)


def test_a_sync_read_is_answered_in_order_in_time_slots() -> None:
    replies = bus_of(1, 2, 3).receive(READ_POSITIONS, 0.0)
    assert ids(replies) == [3, 1, 2]
    asked_s, size = len(READ_POSITIONS) * BYTE_S, 8
    begins = (asked_s + DELAY_S, asked_s + (size + 3) * BYTE_S, asked_s + 2 * (size + 3) * BYTE_S)
    assert [r.due_s for r in replies] == pytest.approx([begin_s + size * BYTE_S for begin_s in begins])


def test_a_silent_servo_leaves_a_gap_and_hides_no_other() -> None:
    bus = bus_of(1, 2, 3)
    whole = bus.receive(READ_POSITIONS, 0.0)
    bus.faults.silence(1)
    replies = bus.receive(READ_POSITIONS, 1.0)
    assert ids(replies) == [3, 2]
    assert replies[1].due_s == pytest.approx(1.0 + whole[2].due_s)
    bus.faults.restore(1)
    assert ids(bus.receive(READ_POSITIONS, 2.0)) == [3, 1, 2]


def test_a_silenced_servo_ignores_instructions() -> None:
    bus = bus_of(1)
    bus.faults.silence(1)
    assert bus.receive(packet(1, Code.WRITE, b"\x29\x07"), 0.0) == []
    assert bus.servo(1).read(sts.acceleration.address, 1) == b"\0"


def test_only_one_reply_is_corrupted() -> None:
    bus = bus_of(1)
    bus.faults.corrupt_next(1)
    (bad,) = bus.receive(packet(1, Code.PING), 0.0)
    (good,) = bus.receive(packet(1, Code.PING), 1.0)
    assert bad.data[:-1] == good.data[:-1]
    assert bad.data[-1] != good.data[-1] == checksum(good.data[2:-1])


def test_a_sync_write_reaches_the_named_servos_without_a_reply() -> None:
    bus = bus_of(1, 2, 3)
    entries = b"\x29\x01" + b"\x01\x07" + b"\x03\x09" + b"\x02"  # the last entry is incomplete
    assert bus.receive(packet(0xFE, Code.SYNC_WRITE, entries), 0.0) == []
    assert [bus.servo(i).read(41, 1) for i in (1, 2, 3)] == [b"\x07", b"\0", b"\x09"]


def test_an_incomplete_sync_write_entry_is_partly_written() -> None:
    bus = bus_of(1)
    bus.receive(packet(0xFE, Code.SYNC_WRITE, b"\x2e\x02\x01\x07"), 0.0)
    assert bus.servo(1).read(46, 2) == b"\x07\0"


def test_a_sync_write_with_too_long_entries_is_ignored() -> None:
    bus = bus_of(1)
    bus.receive(packet(0xFE, Code.SYNC_WRITE, b"\x29\x7e\x01" + bytes(100)), 0.0)
    bus.receive(packet(0xFE, Code.SYNC_WRITE, b"\x29\x7e\x01\x07"), 0.1)
    assert bus.servo(1).read(41, 1) == b"\0"


def test_the_last_of_two_entries_for_one_servo_wins() -> None:
    bus = bus_of(1)
    bus.receive(packet(0xFE, Code.SYNC_WRITE, b"\x29\x01\x01\x07\x01\x09"), 0.0)
    assert bus.servo(1).read(41, 1) == b"\x09"


def test_group_instructions_to_one_id_reach_that_servo() -> None:
    bus = bus_of(1, 2)
    assert ids(bus.receive(packet(2, Code.SYNC_WRITE, b"\x29\x01\x01\x07\x02\x09"), 0.0)) == [2]
    assert [bus.servo(i).read(41, 1) for i in (1, 2)] == [b"\0", b"\x09"]
    (reply,) = bus.receive(packet(2, Code.SYNC_READ, b"\x29\x01\x01\x02"), 1.0)
    assert reply.data == status_packet(2, 0, b"\x09")
    # Duration of the instruction, of one slot and of the reply
    assert reply.due_s == pytest.approx(1.0 + (10 + 10 + 7) * BYTE_S)


def test_a_broadcast_read_is_answered_by_all_at_once() -> None:
    bus = bus_of(1, 2)
    (reply,) = bus.receive(packet(0xFE, Code.READ, b"\x03\x02"), 0.0)
    answers = [status_packet(servo_id, 0, bus.servo(servo_id).read(3, 2)) for servo_id in (1, 2)]
    assert reply.data == bytes(one & other for one, other in zip(*answers, strict=True))


def test_two_ff_bytes_begin_a_packet_even_inside_another() -> None:
    bus = bus_of(1)
    goal = packet(1, Code.WRITE, b"\x2a\xff\xff\0\0")
    assert bus.receive(goal, 0.0) == []
    assert ids(bus.receive(packet(1, Code.PING), 0.1)) == [1]
    assert bus.servo(1).read(42, 2) == b"\0\0"


@pytest.mark.parametrize("parameters", [b"", b"\x29", b"\x29\x01", b"\x29\x05\x01"])
def test_empty_sync_instructions_have_no_effect(parameters: bytes) -> None:
    bus = bus_of(2)
    assert bus.receive(packet(0xFE, Code.SYNC_WRITE, parameters), 0.0) == []
    assert bus.receive(packet(0xFE, Code.SYNC_READ, parameters), 0.0) == []


def test_a_broadcast_write_reaches_all_without_a_reply() -> None:
    bus = bus_of(1, 2)
    assert bus.receive(packet(0xFE, Code.WRITE, b"\x29\x07"), 0.0) == []
    assert [bus.servo(i).read(41, 1) for i in (1, 2)] == [b"\x07", b"\x07"]


def test_a_broadcast_action_starts_all_registered_writes() -> None:
    bus = bus_of(1, 2)
    for servo_id in (1, 2):
        assert ids(bus.receive(packet(servo_id, Code.REG_WRITE, b"\x29\x07"), 0.0)) == [servo_id]
    assert bus.receive(packet(0xFE, Code.ACTION), 0.1) == []
    assert [bus.servo(i).read(41, 1) for i in (1, 2)] == [b"\x07", b"\x07"]


def test_a_broadcast_ping_is_answered_by_each_in_the_slot_of_its_id() -> None:
    replies = bus_of(5, 2, 3).receive(packet(0xFE, Code.PING), 0.0)
    assert ids(replies) == [2, 3, 5]
    assert [r.due_s for r in replies] == pytest.approx([(6 + 9 * n + 6) * BYTE_S for n in (2, 3, 5)])


def test_a_new_baud_rate_applies_after_the_reply() -> None:
    bus = bus_of(1)
    assert bus.receive(packet(1, Code.PING), 0.0, 115_200) == []
    assert len(bus.receive(packet(1, Code.WRITE, b"\x06\x04"), 1.0)) == 1
    assert bus.receive(packet(1, Code.PING), 2.0) == []
    (reply,) = bus.receive(packet(1, Code.PING), 3.0, 115_200)
    assert reply.due_s == pytest.approx(3.0 + 130 / 115_200)


def test_two_servos_with_the_same_id_corrupt_each_others_replies() -> None:
    bus = bus_of(1, 2)
    bus.servo(2).write(sts.servo_id.address, b"\x01")
    assert ids(bus.receive(packet(1, Code.PING), 0.0)) == [1]  # equal replies do not show the conflict
    bus.servos[0].write(sts.acceleration.address, b"\x0f")
    bus.servos[1].write(sts.acceleration.address, b"\x35")
    (reply,) = bus.receive(packet(1, Code.READ, b"\x29\x01"), 0.1)
    assert reply.data[5] == 0x05
    assert checksum(reply.data[2:-1]) != reply.data[-1]


def test_a_half_packet_is_discarded_at_the_next_header() -> None:
    bus = bus_of(1)
    assert bus.receive(b"\xff\xff\x01\x70\x03", 0.0) == []
    assert ids(bus.receive(packet(1, Code.PING), 1.0)) == [1]


def test_the_rest_of_a_half_packet_can_come_at_any_time() -> None:
    bus, ping = bus_of(1), packet(1, Code.PING)
    assert bus.receive(ping[:4], 0.0) == []
    assert ids(bus.receive(ping[4:], 5.0)) == [1]


def test_a_packet_in_two_portions_is_answered_after_the_second() -> None:
    bus = bus_of(1)
    ping = packet(1, Code.PING)
    assert bus.receive(ping[:4], 0.0) == []
    (reply,) = bus.receive(ping[4:], 0.001)
    assert reply.due_s == pytest.approx(0.001 + 8 * BYTE_S + DELAY_S)


@pytest.mark.parametrize(
    ("variant", "torque", "moves"),
    [
        (StsVariant(), (1, 1), True),
        (StsVariant(goal_write_energises=False), (0, 1), False),
        (StsVariant(goal_write_energises=False, torque_on_takes_goal=True), (0, 1), True),
    ],
)
def test_a_line_of_servos_with_other_firmware(variant: StsVariant, torque: tuple[int, int], moves: bool) -> None:
    bus = VirtualBus.of(BenchPlant([1]), variant=variant)
    bus.receive(packet(1, Code.WRITE, b"\x2a\x00\x09"), 0.0)
    bus.advance(0.5)
    assert bus.servo(1).read(40, 1)[0] == torque[0]
    bus.receive(packet(1, Code.WRITE, b"\x28\x01"), 0.5)
    bus.advance(1.5)
    assert bus.servo(1).read(40, 1)[0] == torque[1]
    position = int.from_bytes(bus.servo(1).read(56, 2), "little")
    assert position == pytest.approx(0x900 if moves else 2048, abs=3)


def test_physics_follows_the_callers_time() -> None:
    bus = bus_of(1)
    bus.servo(1).write(sts.goal_position.address, b"\0\x04")
    bus.advance(100.0)
    before = bus.servo(1).read(56, 2)
    bus.advance(100.3)
    assert bus.servo(1).read(56, 2) != before
    assert bus.dropped_s == 0.0


def test_time_beyond_the_maximum_is_skipped_and_counted() -> None:
    bus = bus_of(1)
    bus.advance(0.0)
    bus.advance(5.0, longest_s=0.2)
    assert bus.dropped_s == pytest.approx(4.8)
    bus.advance(5.1, longest_s=0.2)
    assert bus.dropped_s == pytest.approx(4.8)


def test_a_rig_requires_servos_in_the_order_of_the_plant() -> None:
    servos = [VirtualServo(sts.STS3215, i) for i in (2, 1)]
    with pytest.raises(ValueError, match="same IDs"):
        Rig(servos, BenchPlant([1, 2]))


class OneJointWorld:
    """A world that records the calls."""

    joints = ("free", "finger")
    timestep_s = 0.001
    time_s = 0.0

    def __init__(self) -> None:
        # The arrays contain more values than the joints, and each array has a different order.
        position, velocity = np.array([9.0, 9.0, 0.02]), np.array([-0.04, 9.0])
        self.arrays = JointArrays(position, velocity, np.zeros(2), [1, 2], [1, 0], [0, 1])

    def advance(self) -> None:
        self.time_s += self.timestep_s


def test_a_coupling_converts_meters_to_radians_and_torque_to_force() -> None:
    world = OneJointWorld()
    seen: list[float] = []
    coupling = Coupling(7, "finger", sign=-1, zero_counts=1024, transmission=0.02)
    plant = WorldPlant(world, [coupling], seen.append)
    assert plant.angles() == pytest.approx([-1.0 + coupling.zero_rad])
    assert plant.velocities() == pytest.approx([2.0])
    plant.push([0.5])
    plant.advance()
    assert world.arrays.effort == pytest.approx([0.0, -25.0])
    assert seen == [0.001]


def test_a_coupling_to_an_unknown_joint_is_refused() -> None:
    with pytest.raises(ValueError, match="no joint elbow"):
        WorldPlant(OneJointWorld(), [Coupling(1, "elbow")])
