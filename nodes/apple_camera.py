"""Run the ``apple_camera`` node, which grades apples with a camera.

Usage: ``python -m nodes.apple_camera [--network] --ros-args -p source:=/dev/video0 …``. The node is implemented in
perception/.
"""

import sys
from collections.abc import Sequence

from nodes.ros_environment import RosError, require_ros


def main(args: Sequence[str] | None = None) -> int:
    """Run the node until SIGINT, SIGTERM or SIGHUP and return the exit status. ``args`` has the same form as
    sys.argv."""
    try:
        require_ros()
        from nodes.perception.process import run  # Importing rclpy terminates a process that has no middleware.

        return run(sys.argv if args is None else args)
    except RosError as error:
        print(f"apple_camera: {error}", file=sys.stderr)
        return 1


if __name__ == "__main__":
    sys.exit(main())
