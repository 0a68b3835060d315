"""Dynamixel arms whose servos have old firmware, which the robot file names."""

from pathlib import Path

import pytest
import yaml

from drivers.servos import x
from servoloop.simulation.stack import SimulatedStack
from servoloop.stack.robot_files import CONFIG, read_files
from sim_backend.packets.dynamixel import Code
from tests.stack.rig import UnpacedJob

ARM = CONFIG / "robot_arm_dynamixel.yaml"


def stack_with(folder: Path, firmware: dict[str, int]) -> SimulatedStack:
    """Return a stack whose joints have these firmware versions."""
    content = yaml.safe_load(ARM.read_text())
    for name, version in firmware.items():
        content["joints"][name]["firmware"] = version
    path = folder / "robot.yaml"
    path.write_text(yaml.safe_dump(content))
    return SimulatedStack(files=read_files(robot=path))


def joints() -> list[str]:
    return list(yaml.safe_load(ARM.read_text())["joints"])


@pytest.mark.parametrize("version", [38, 41, 44])
def test_an_arm_with_old_firmware_does_the_job_without_fast_sync_reads(tmp_path: Path, version: int) -> None:
    rig = stack_with(tmp_path, dict.fromkeys(joints(), version))
    sent: list[int] = []
    receive = rig.bus.receive

    def record(data: bytes, now_s: float, baud: int = 1_000_000) -> object:
        sent.append(data[7])
        return receive(data, now_s, baud)

    rig.bus.receive = record  # type: ignore[method-assign,assignment]
    rig.up()
    assert [servo.memory.get(x.firmware_version) for servo in rig.bus.servos] == [version] * len(joints())
    job = UnpacedJob(rig, "A")
    job.run()
    rig.run(1.0)
    assert rig.world.cube_bin() == "A"
    assert rig.loop.figures.missed == 0
    assert sent.count(Code.FAST_SYNC_READ) <= 1, "only the trial"


def test_one_servo_with_old_firmware_ends_the_use_of_fast_sync_reads(tmp_path: Path) -> None:
    rig = stack_with(tmp_path, {joints()[3]: 44}).up()
    rig.run(1.0)
    assert rig.loop.figures.missed == 0
