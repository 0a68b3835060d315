"""``python -m tests.ros.unknown_rclpy ...``: servoloop on an rclpy that says it is of a version nobody knows."""

from nodes.rclpy_patches import guard
from servoloop.cli import main

guard.rclpy_version = lambda: "7.1.99"

if __name__ == "__main__":
    main()
