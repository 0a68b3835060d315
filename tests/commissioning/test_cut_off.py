"""A tool that is interrupted at any packet locks the EEPROM and restores the port's baud rate."""

from collections.abc import Callable
from typing import Any

import pytest

from commissioning.provision import provision
from commissioning.registers.access import write_register
from commissioning.registers.address import factory_reset, reboot, set_baud, set_id
from commissioning.scan.find import FoundServo, find_servo
from drivers.driver_errors import DriverError
from drivers.servos import sts
from sim_backend.buses.port import VirtualPort
from sim_backend.clock import SimulatedClock
from tests.commissioning.lines import ToolLine

TOOLS: dict[str, Callable[[FoundServo], Any]] = {
    "write": lambda servo: write_register(servo, "max_temperature", 61),
    "set-id": lambda servo: set_id(servo, 7),
    "set-baud": lambda servo: set_baud(servo, 500_000),
    "factory-reset": factory_reset,
    "reboot": reboot,
    "settings": lambda servo: provision(
        servo.bus, servo.clock, 3, servo.model, {sts.position_p: 16, sts.max_temperature: 61}
    ),
    "torque on": lambda servo: write_register(servo, "torque_enable", 1, torque=True),
}
every_tool = pytest.mark.parametrize("tool", TOOLS)


class CutPort(VirtualPort):
    """A port that fails before packet number ``at`` or, if ``behind`` is true, after the reply to this packet."""

    happens: Callable[[], None] = staticmethod(lambda: None)
    at, behind, sent = 0, False, 0

    def write(self, data: bytes) -> None:
        self.sent += 1
        self._now(False)
        super().write(data)

    def read(self, size: int, deadline_s: float) -> bytes:
        data = super().read(size, deadline_s)
        self._now(True)
        return data

    def _now(self, behind: bool) -> None:
        if (self.sent, behind) == (self.at, self.behind):
            self.at = 0
            self.happens()


def run_cut(tool: str, at: int, what: Callable[[CutPort], None], behind: bool = False) -> tuple[ToolLine, CutPort]:
    """Run a tool, and return the bus and its port afterwards."""
    line = ToolLine(dict.fromkeys((1, 3), sts.STS3215))
    port = CutPort(line.servos, line.clock)
    try:
        with find_servo(port, line.clock, 3) as servo:
            port.sent, port.at, port.behind, port.happens = 0, at, behind, lambda: what(port)
            TOOLS[tool](servo)
    except (KeyboardInterrupt, DriverError):
        pass
    return line, port


def packets(tool: str) -> range:
    """Return the numbers of all packets that the tool sends."""
    _, port = run_cut(tool, 0, interrupt)
    assert port.sent > 5
    return range(1, port.sent + 1)


def interrupt(port: CutPort) -> None:
    raise KeyboardInterrupt


@every_tool
@pytest.mark.parametrize("behind", [False, True])
def test_ctrl_c_at_any_packet_leaves_the_eeprom_locked_and_restores_the_baud_rate(tool: str, behind: bool) -> None:
    for number in packets(tool):
        line, port = run_cut(tool, number, interrupt, behind)
        servo = line.servos.servos[1]
        assert [one.memory.get(sts.lock) for one in line.servos.servos] == [1, 1], number
        assert port.baud == 1_000_000
        before = servo.servo_id, servo.baud
        assert before in ((3, 1_000_000), (7, 1_000_000), (3, 500_000))
        servo.power_cycle()
        assert (servo.servo_id, servo.baud) == before, number


@pytest.mark.parametrize("tool", ["write", "set-id", "set-baud", "settings"])
def test_after_a_lost_port_the_next_write_locks_the_eeprom(tool: str) -> None:
    for number in packets(tool):
        line, _ = run_cut(tool, number, CutPort.unplug)
        servo = line.servos.servos[1]
        clock = SimulatedClock(line.clock.now())
        with find_servo(VirtualPort(line.servos, clock), clock, servo.servo_id) as found:
            write_register(found, "min_voltage", 45)
        assert servo.memory.get(sts.lock) == 1


@pytest.mark.parametrize("behind", [False, True])
def test_an_interrupted_torque_switch_leaves_torque_off_or_the_servo_in_place(behind: bool) -> None:
    for number in packets("torque on"):
        line, _ = run_cut("torque on", number, interrupt, behind)
        memory = line.servos.servos[1].memory
        before = memory.get(sts.present_position)
        line.servos.advance(line.clock.now() + 1.0)
        assert abs(memory.get(sts.present_position) - before) <= 2
