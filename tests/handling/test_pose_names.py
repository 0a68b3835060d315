"""Names of poses: what can be typed and printed again."""

from pathlib import Path

import pytest

from servoloop.handling.poses import PoseError, Poses


@pytest.mark.parametrize("name", ["", "  ", "a\nb", "\x1b[2J", "x" * 101])
def test_a_name_that_cannot_be_printed_is_refused(tmp_path: Path, name: str) -> None:
    with pytest.raises(PoseError, match="is not a name for a pose: use 1 to 100 printable characters"):
        Poses(tmp_path).save(name, {"joint1": 0.0})
    Poses(tmp_path).save("über der Kiste", {"joint1": 0.0})
