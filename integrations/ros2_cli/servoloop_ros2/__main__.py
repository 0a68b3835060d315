"""Run the ``ros2`` command with ``python -m servoloop_ros2``."""

from servoloop_ros2.cli import main

if __name__ == "__main__":
    main()
