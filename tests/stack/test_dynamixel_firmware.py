"""Jobs of Dynamixel arms with old firmware, as set in the robot file, and with a servo that is silent at times."""

from pathlib import Path

import pytest
import yaml

from controller.action_goals import GoalStatus
from drivers.servos import x
from servoloop.simulation.stack import SimulatedStack
from servoloop.stack.robot_files import read_files
from servoloop.stack.shipped_files import CONFIG
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


class Interrupted(UnpacedJob):
    """Job in which one servo falls silent for 0.2 s repeatedly."""

    def __init__(self, rig: SimulatedStack, grade: str, servo_id: int) -> None:
        super().__init__(rig, grade)
        self._bus, self._clock, self._servo_id = rig.bus, rig.clock, servo_id
        self._begin_s = rig.clock.now()

    def react(self) -> None:
        super().react()
        faults, since_s = self._bus.faults, self._clock.now() - self._begin_s
        (faults.silence if since_s % 2.0 < 0.2 else faults.restore)(self._servo_id)


@pytest.mark.parametrize("firmware", [None, 44], ids=["fast sync read", "sync read"])
@pytest.mark.parametrize("servo_id", [4, *(pytest.param(i, marks=pytest.mark.slow) for i in (1, 7))])
def test_the_job_succeeds_although_a_servo_is_silent_for_a_moment(
    tmp_path: Path, servo_id: int, firmware: int | None
) -> None:
    rig = stack_with(tmp_path, {} if firmware is None else dict.fromkeys(joints(), firmware)).up()
    rig.run(0.2)
    job = Interrupted(rig, "B", servo_id)
    job.run()
    rig.run(1.0)
    assert [handle.status for handle in job.handles] == [GoalStatus.SUCCEEDED] * 4
    assert rig.world.cube_bin() == "B"
