"""If a script runs the loop itself, it must define how the arm is shut down."""

import pytest

from servoloop.api.own_loop import OwnLoop
from servoloop.stack.arm_folders import find_arm, read_arm_files


def test_a_loop_without_a_shutdown_cannot_be_created() -> None:
    with pytest.raises(TypeError, match="close"):
        OwnLoop(read_arm_files(find_arm("so101")))  # type: ignore[abstract]
