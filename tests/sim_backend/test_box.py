"""The virtual box: only connected servos answer and have power."""

import pytest

from drivers.bus.bus import Bus
from drivers.servos import sts
from drivers.types import ServoFault
from sim_backend.box import VirtualBox, plugged
from sim_backend.buses.port import VirtualPort
from sim_backend.clock import SimulatedClock
from sim_backend.servos.sts.servo import VirtualServo


class Line:
    def __init__(self, count: int = 3) -> None:
        self.box, self.clock = VirtualBox([sts.STS3215] * count), SimulatedClock(10.0)
        self.bus = Bus(VirtualPort(self.box.line, self.clock), self.clock)

    def answers(self, servo_id: int = 1) -> str:
        """Return "ok" or the kind of fault."""
        reading = self.bus.read_states([servo_id])[servo_id]
        return reading.kind if isinstance(reading, ServoFault) else "ok"

    def servo(self, number: int) -> VirtualServo:
        servo = self.box.servos[number]
        assert isinstance(servo, VirtualServo)
        return servo


def test_replies_of_no_one_and_two_servos_with_the_same_id() -> None:
    line = Line()
    assert line.answers() == "silent"
    line.box.connect(1)
    assert line.answers() == "ok"
    line.box.connect(1, 2)
    assert line.answers() == "corrupt"
    assert line.box.ids() == [1, 1, 1]


def test_unplugging_a_servo_resets_its_ram() -> None:
    line = Line()
    line.box.connect(0)
    line.bus.write(1, sts.position_p, 16)  # the lock is closed at this time
    line.bus.write(1, sts.torque_enable, 1)
    line.bus.write(1, sts.lock, 0)
    line.bus.write(1, sts.position_d, 40)
    line.box.connect(0)
    assert line.bus.read(1, sts.torque_enable) == 1  # this servo was not unplugged
    line.box.connect()
    assert line.servo(0).memory.get(sts.torque_enable) == 0
    line.box.connect(0)
    held = [line.bus.read(1, register) for register in (sts.position_p, sts.position_d, sts.torque_enable, sts.lock)]
    assert held == [32, 40, 0, 1]


def test_factory_limits_and_delays_of_new_servos() -> None:
    box = VirtualBox([sts.STS3215_C001, sts.STS3215])
    limits = [servo.memory.get(sts.max_voltage) for servo in box.servos]
    assert limits == [80, 140]
    assert [servo.memory.get(sts.return_delay) for servo in box.servos] == [250, 250]


def test_servos_are_connected_and_disconnected_by_command() -> None:
    line, seen = Line(), []
    joints = ["a", "b", "c"]

    def hand(command: object) -> dict[str, str]:
        seen.append(command)
        return {}

    said = plugged(line.box, joints, hand, {"do": "connect", "joints": ["b"]})
    assert line.answers() == "ok"
    assert {name: state["connected"] for name, state in said.items()} == {"a": False, "b": True, "c": False}
    assert said["b"]["servo_id"] == 1
    plugged(line.box, joints, hand, {"do": "connect", "joints": []})
    assert line.answers() == "corrupt"
    plugged(line.box, joints, hand, {"do": "disconnect"})
    assert line.answers() == "silent"
    plugged(line.box, joints, hand, {"do": "hold", "joints": []})
    assert seen[-1] == {"do": "hold", "joints": []}
    with pytest.raises(ValueError, match="no servo for z: its joints are a, b, c"):
        plugged(line.box, joints, hand, {"do": "connect", "joints": ["z"]})
