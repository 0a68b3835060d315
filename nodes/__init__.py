"""ROS 2 interface of the control stack. Only this package imports rclpy, and it does not contain any control logic."""
