"""The ROS 2 interface of the stack. Only this package imports rclpy, and it contains no control logic."""
