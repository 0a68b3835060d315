"""ROS times for tests."""

from builtin_interfaces.msg import Time
from rclpy.time import Time as RosTime


def time_message(since_1970_s: float) -> Time:
    """Convert seconds since the epoch to a ROS time."""
    return RosTime(nanoseconds=round(since_1970_s * 1e9)).to_msg()
