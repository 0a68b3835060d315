"""Run servoloop with an rclpy that reports an unknown version: ``python -m tests.ros.unknown_rclpy ...``."""

from nodes.rclpy_patches import guard
from servoloop.cli import main

guard.rclpy_version = lambda: "7.1.99"

if __name__ == "__main__":
    main()
