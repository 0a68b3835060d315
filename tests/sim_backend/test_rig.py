"""The compiled timestep of all servos of a line gives the same result as simulating the servos one after the other."""

import pytest

from drivers.servos import sts
from sim_backend.buses.feetech import VirtualBus
from sim_backend.line.rig import Rig, Supply
from sim_backend.mechanics.plant import Coupling, WorldPlant
from sim_backend.scene.world import World
from sim_backend.servos.generic.packet_servo import PacketServo
from sim_backend.servos.sts.servo import VirtualServo
from tests.sim_backend.robot_arm import JOINTS

COUPLINGS = [
    Coupling(servo_id, joint, sign=1 if servo_id % 2 else -1, transmission=0.03 if joint == JOINTS[6] else 1.0)
    for servo_id, joint in enumerate(JOINTS, 1)
]


class Arm:
    """Seven servos on two supplies with the same voltage. The voltage of one supply sags strongly under load."""

    def __init__(self) -> None:
        self.world = World()
        self.servos = [VirtualServo(sts.STS3215, coupling.servo_id) for coupling in COUPLINGS]
        stiff, also_stiff, soft = Supply(12.0, 0.0), Supply(12.0, 0.0), Supply(12.0, 0.5)
        supplies = [stiff, also_stiff, soft, soft, soft, soft, stiff]
        self.rig: Rig[PacketServo] = Rig(self.servos, WorldPlant(self.world, COUPLINGS), supplies)
        self.line = VirtualBus(self.rig)

    def work(self) -> list[bytes]:
        """Move to distant goals, with a reboot during the motion. Return the state after each millisecond."""
        seen = []
        for servo in self.servos:
            goal = sts.goal_position.encode(2300, "little")
            self.line.receive(bytes_of_write(servo.servo_id, sts.goal_position.address, goal), 0.0)
        for ms in range(1200):
            if ms == 100:
                self.line.receive(packet(3, 0x08), 0.1)
            self.rig.step()
            tables = b"".join(servo.read(0, 87) for servo in self.servos)
            powers = [(s.firmware.voltage_v, s.firmware.supply_current_a, s.deaf) for s in self.servos]
            seen.append(self.world.position().tobytes() + tables + repr(powers).encode())
        return seen


def packet(servo_id: int, code: int, parameters: bytes = b"") -> bytes:
    body = bytes((servo_id, len(parameters) + 2, code)) + parameters
    return b"\xff\xff" + body + bytes((~sum(body) & 0xFF,))


def bytes_of_write(servo_id: int, address: int, data: bytes) -> bytes:
    return packet(servo_id, 3, bytes((address,)) + data)


def test_the_compiled_step_equals_single_steps_bit_for_bit(monkeypatch: pytest.MonkeyPatch) -> None:
    at_once = Arm().work()
    monkeypatch.setattr(Rig, "_compiled", lambda rig: None)
    assert at_once == Arm().work()


def test_a_supply_sags_only_under_its_own_servos() -> None:
    arm = Arm()
    arm.work()
    assert [servo.firmware.voltage_v for servo in arm.servos[:2]] == [12.0, 12.0]
    assert len({servo.firmware.voltage_v for servo in arm.servos[2:6]}) == 1
    assert arm.servos[2].firmware.voltage_v < 12.0


def test_a_servo_keeps_its_state_when_it_moves_to_another_line() -> None:
    arm = Arm()
    arm.servos[0].write(sts.goal_velocity.address, b"\x34\x12")
    before = arm.servos[0].read(0, 87)
    Rig(arm.servos, WorldPlant(arm.world, COUPLINGS))
    assert arm.servos[0].read(42, 14) == before[42:56]
    arm.servos[0].write(sts.goal_velocity.address, b"\x78\x16")
    assert arm.servos[0].read(46, 2) == b"\x78\x16"
