"""``python -m tests.servoloop.without_ros VERB …``: run servoloop as if ROS were not installed."""

import sys
from collections.abc import Sequence
from importlib.abc import MetaPathFinder
from importlib.machinery import ModuleSpec
from types import ModuleType


class NoRos(MetaPathFinder):
    """Module finder that hides ROS: rclpy and the message packages."""

    def __init__(self, others: Sequence[MetaPathFinder]) -> None:
        self._others = tuple(others)

    def find_spec(
        self, fullname: str, path: Sequence[str] | None, target: ModuleType | None = None
    ) -> ModuleSpec | None:
        top = fullname.partition(".")[0]
        if top == "rclpy" or top.endswith(("_msgs", "_interfaces")):
            return None
        specs = (other.find_spec(fullname, path, target) for other in self._others)
        return next((spec for spec in specs if spec is not None), None)


if __name__ == "__main__":
    sys.meta_path[:] = [NoRos(sys.meta_path)]  # type: ignore[arg-type]
    from servoloop.cli import main

    main()
