"""Names of poses must be printable."""

from pathlib import Path

import pytest

from hal.types import JointLimits
from servoloop.manual.poses import PoseError, Poses


@pytest.mark.parametrize("name", ["", "  ", "a\nb", "\x1b[2J", "x" * 101])
def test_a_name_that_cannot_be_printed_is_refused(tmp_path: Path, name: str) -> None:
    with pytest.raises(PoseError, match="is not a valid pose name; use 1 to 100 printable characters"):
        Poses(tmp_path).save(name, {"joint1": 0.0})
    Poses(tmp_path).save("über der Kiste", {"joint1": 0.0})


def test_an_invalid_pose_is_reported_with_file_and_line(tmp_path: Path) -> None:
    poses = Poses(tmp_path)
    poses.path.write_text("poses:\n  home: {elbow: 0.1}\n  far: {elbow: 3.0, wrist: 0.0}\n")
    limits = {"elbow": JointLimits(-1.0, 1.0, 1.0, 1.0, 1.0)}
    poses.check("home", limits)
    with pytest.raises(
        PoseError, match=r"poses.yaml:3: pose far: the arm has no joint wrist; elbow: 3.0000 is outside its"
    ):
        poses.check("far", limits)
