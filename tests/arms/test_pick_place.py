"""Pick-and-place parameters of an arm: values that the node would refuse are reported as mistakes in the file."""

from pathlib import Path

import pytest

from hal.hal_errors import ArmFileError
from servoloop.stack.arm_folders import find_arm
from servoloop.stack.pick_place import load_pick_place


@pytest.mark.parametrize(
    ("old", "new", "says"),
    [
        ("A: [0.4", "A: [.nan", "bins.A.0: must be a finite number"),
        ("ready: [0.0", "ready: [-.inf", "poses.ready.0: must be a finite number"),
        ("hand_open_m: 0.0", "hand_open_m: .nan", "hand_open_m: must be a finite number"),
        ("A: [0.4", "A: [9.2e18", "bins.A.0: must be -2000 to 2000 rad or m, not 9.2e+18"),
        ("A: [0.4,", "A: [0,", "bins.A mixes float and int in one list: use one type for all elements"),
        ("vision_pick_place_controller:", "picker:", "vision_pick_place_controller is missing: put the parameters"),
        ("grades: [A, B, C]", "grades: [A, B, C, ' c']", "grade  c has no pose under bins"),
        ("      C:", "      c:", "grade C has no pose under bins"),
    ],
)
def test_values_refused_by_the_node_are_reported_with_the_file(tmp_path: Path, old: str, new: str, says: str) -> None:
    text = find_arm().pick_place.read_text()
    assert old in text
    path = tmp_path / "pick_place.yaml"
    path.write_text(text.replace(old, new))
    with pytest.raises(ArmFileError) as error:
        load_pick_place(path)
    assert says in str(error.value)
    assert str(error.value).startswith(f"{path}:")


def test_unusable_grade_is_reported_with_the_file(tmp_path: Path) -> None:
    path = tmp_path / "pick_place.yaml"
    text = find_arm().pick_place.read_text()
    path.write_text(text.replace("[A, B, C]", "[A, B, c]").replace("      C:", "      c:"))
    with pytest.raises(ArmFileError, match="grade 'c' matches no request: write 'C'"):
        load_pick_place(path)
