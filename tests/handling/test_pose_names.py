"""Pose files: names are printable, saved positions are within the limits, and errors name the line."""

from pathlib import Path

import pytest

from hal.types import JointLimits
from servoloop.manual.poses import PoseError, Poses, inside


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


@pytest.mark.parametrize(
    ("measured", "saved", "warnings"),
    [
        (-0.1749, -0.174533, ["gripper was measured at -0.1749 and is saved at its limit -0.1745"]),
        (1.9, 1.69297, ["gripper was measured at 1.9000 and is saved at its limit 1.6930"]),
        (0.5, 0.5, []),
    ],
)
def test_a_position_measured_beyond_a_limit_is_saved_at_the_limit(
    tmp_path: Path, measured: float, saved: float, warnings: list[str]
) -> None:
    """Without this, `pose go` would refuse the saved pose of a closed gripper."""
    limits = {"gripper": JointLimits(-0.174533, 1.69297, 1.0, 1.0, 1.0)}
    pose, said = inside({"gripper": measured}, limits)
    assert (pose, said) == ({"gripper": saved}, warnings)
    poses = Poses(tmp_path)
    poses.save("closed", pose)
    poses.check("closed", limits)
    assert poses.get("closed") == {"gripper": saved}
