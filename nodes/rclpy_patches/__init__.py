"""Patches of rclpy, and code that uses its private parts. Each patch states its purpose and the rclpy versions that it
supports."""
