"""Run the ``vision_pick_place_controller`` node, which picks an apple and puts it into the bin for its grade.

Usage: ``python -m nodes.vision_pick_place_controller [--network] --ros-args …``. The node itself is in pick_place/.
"""

import sys
from collections.abc import Sequence

from nodes.ros_environment import RosError, require_ros


def main(args: Sequence[str] | None = None) -> int:
    """Run the node until SIGINT, SIGTERM or SIGHUP and return the exit status. ``args`` is in the form of sys.argv."""
    try:
        require_ros()
        from nodes.pick_place.process import run  # rclpy terminates a process without middleware on import.

        return run(sys.argv if args is None else args)
    except RosError as error:
        print(f"vision_pick_place_controller: {error}", file=sys.stderr)
        return 1


if __name__ == "__main__":
    sys.exit(main())
