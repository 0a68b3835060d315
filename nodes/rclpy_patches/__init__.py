"""The parts of rclpy that are private or replaced: for each the versions it is known for, and its purpose."""
