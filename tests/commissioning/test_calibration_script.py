"""The script in docs/calibration-scripts.md runs on a virtual arm."""

import shutil
from collections.abc import Callable, Sequence
from pathlib import Path

import pytest

import drivers.clock
import servoloop.stack.hardware
from drivers.bus.bus import Bus
from servoloop.stack.shipped_files import ARMS
from tests.commissioning.arm import Person, UnalignedArm
from tests.pages import code

PAGE = "calibration-scripts.md"


@pytest.mark.slow
@pytest.mark.runs(f"{PAGE} python 1")
def test_the_script_calibrates_an_arm(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    shutil.copytree(ARMS / "so101", tmp_path / "so101")
    arm = UnalignedArm(4, 1.0, "so101")
    person = Person(arm, arm.plan.joints)

    def move_joints(kind: str, joints: Sequence[str], update: Callable[[], None]) -> None:
        person.move(kind, joints, update)

    def virtual_bus(*_: object) -> Bus:
        return arm.open_bus(arm.joints)

    script = code(PAGE, "python").replace("SerialPort(PORT, 1_000_000, clock)", "None")
    monkeypatch.setattr(servoloop.stack.hardware, "servo_bus", virtual_bus)
    monkeypatch.setattr(drivers.clock, "MonotonicClock", lambda: arm.clock)
    arm.hand.hold()
    exec(
        script,
        {"ARM": str(tmp_path / "so101"), "PORT": "", "move_joints": move_joints, "release_joints": arm.hand.release},
    )
    assert (tmp_path / "so101" / "robot.calibration.yaml").exists()
