"""Patches of rclpy and uses of its private parts. Each patch states its purpose and the rclpy versions it supports."""
