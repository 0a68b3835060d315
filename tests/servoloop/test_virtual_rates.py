"""Virtual servos use the baud rate of the robot file."""

from pathlib import Path

import pytest

from hal.hal_errors import RobotFileError
from servoloop.stack.emulator import couplings, virtual_bus
from servoloop.stack.hardware import servo_bus
from servoloop.stack.robot_files import read_files
from servoloop.stack.shipped_files import CONFIG
from sim_backend.buses.port import VirtualPort
from sim_backend.clock import SimulatedClock
from sim_backend.mechanics.plant import WorldPlant
from sim_backend.scene.world import World


@pytest.mark.parametrize(
    ("file", "baud"),
    [("robot_arm.yaml", 500_000), ("robot_arm.yaml", 38_400), ("robot_arm_dynamixel.yaml", 57_600)],
)
def test_every_servo_answers_at_the_rate_of_the_file_also_after_a_restart(tmp_path: Path, file: str, baud: int) -> None:
    files = read_files(robot=at_rate(tmp_path, file, baud))
    line = virtual_bus(files.robot, WorldPlant(World(), couplings(files.robot)))
    clock = SimulatedClock()
    bus = servo_bus(files.robot.file, VirtualPort(line, clock, baud=baud, name="line"), clock)
    for joint in files.robot.joints:
        bus.identify(joint.servo_id, joint.model)
        line.servo(joint.servo_id).power_cycle()
    clock.sleep_until(2.0)
    for joint in files.robot.joints:
        bus.identify(joint.servo_id, joint.model)


def test_an_unsupported_rate_is_refused_with_the_supported_rates(tmp_path: Path) -> None:
    files = read_files(robot=at_rate(tmp_path, "robot_arm.yaml", 57_601))
    with pytest.raises(RobotFileError, match=r"joint1: an sts3215 supports 38400, .*1000000 baud, not 57601"):
        virtual_bus(files.robot, WorldPlant(World(), couplings(files.robot)))


def at_rate(folder: Path, file: str, baud: int) -> Path:
    text = (CONFIG / file).read_text()
    changed = text.replace("baud: 1000000", f"baud: {baud}")
    assert changed != text
    path = folder / file
    path.write_text(changed)
    return path
