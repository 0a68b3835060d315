"""A cycle rate that exceeds the capacity of a bus is refused with a calculation, but the highest possible rate is
accepted."""

from pathlib import Path
from typing import Any

import pytest

from controller.manager_errors import ControllersFileError
from servoloop.stack.emulator import couplings, virtual_lines
from servoloop.stack.hardware import servo_bus
from servoloop.stack.line_rate import check_rates
from servoloop.stack.robot_files import read_files
from servoloop.stack.shipped_files import CONFIG
from sim_backend.buses.port import VirtualPort
from sim_backend.clock import SimulatedClock
from sim_backend.line.line import ServoLine
from sim_backend.mechanics.plant import WorldPlant
from sim_backend.scene.world import World

FILE = Path("arm_controllers.yaml")


def port(line: ServoLine[Any], clock: SimulatedClock, name: str, bauds: dict[str, int]) -> VirtualPort:
    return VirtualPort(line, clock, baud=bauds.get(name, 1_000_000), name=name or "line")


def check(rates_hz: dict[str, float], robot: Path | None = None, bauds: dict[str, int] | None = None) -> None:
    files, clock = read_files(robot=robot), SimulatedClock()
    lines = virtual_lines(files.robot, WorldPlant(World(), couplings(files.robot)))
    buses = {
        name: servo_bus(
            files.robot.file,
            VirtualPort(line, clock, baud=(bauds or {}).get(name, 1_000_000), name=name or "line"),
            clock,
            name,
        )
        for name, line in lines.items()
    }
    check_rates(buses, rates_hz, files.robot, FILE)


def test_seven_servos_need_177_bytes_a_cycle() -> None:
    """Goals 8 + 7 * 8 bytes, request 8 + 7 bytes, seven replies of 14 bytes: 1.77 ms at 1 Mbit/s, or 564.97 Hz."""
    check({"": 564.0})
    with pytest.raises(ControllersFileError) as refused:
        check({"": 565.0})
    assert str(refused.value) == (
        "arm_controllers.yaml: 565 Hz is too fast for line. The goals and states of 7 servos take 177 bytes or 1.77 ms "
        "per cycle at 1000000 bit/s, but the period is 1.77 ms: set update_rate to 564 or less, set rw_rate in the "
        "URDF, or raise the servos' baud rate"
    )


def test_a_slower_bus_allows_a_lower_rate() -> None:
    check({"": 65.0}, bauds={"": 115_200})
    with pytest.raises(
        ControllersFileError, match=r"66 Hz is too fast .* 15.36 ms per cycle at 115200 bit/s.* to 65 or less"
    ):
        check({"": 66.0}, bauds={"": 115_200})


def test_each_of_two_buses_has_its_own_servos_and_rate() -> None:
    two = CONFIG / "robot_arm_two_buses.yaml"
    check({"arm": 600.0, "hand": 1000.0}, two)
    with pytest.raises(ControllersFileError) as refused:
        check({"arm": 700.0, "hand": 1000.0}, two)
    assert str(refused.value).startswith("arm_controllers.yaml: 700 Hz is too fast for arm. The goals and states of 6")
    with pytest.raises(ControllersFileError) as refused:
        check({"arm": 700.0, "hand": 5000.0}, two)
    assert [line.split(". ")[0] for line in str(refused.value).splitlines()] == [
        "arm_controllers.yaml: 700 Hz is too fast for arm",
        "arm_controllers.yaml: 5000 Hz is too fast for hand",
    ]
