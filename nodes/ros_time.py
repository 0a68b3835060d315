"""Provide ROS time to the nodes of a stack: system time, or the time of a simulated control loop."""

from time import time

from builtin_interfaces.msg import Time
from rclpy.clock import ROSClock
from rclpy.time import Time as RosTimePoint
from rclpy.time_source import TimeSource

from drivers.clock import Clock, wall_offset_s


class RosTime:
    """ROS time shared by all nodes of a stack. ``advance`` sets simulated time, so the nodes do not need to read
    /clock."""

    def __init__(self, loop: Clock, simulated: bool) -> None:
        self.clock = ROSClock()
        self.simulated = simulated
        self._loop = loop
        if simulated:
            source = TimeSource()  # Without a node, the time source does not subscribe to /clock.
            source.attach_clock(self.clock)
            source.ros_time_is_active = True
            self.advance(self.stamp(loop.now()))

    def offset_s(self) -> float:
        """Return the offset that converts the loop's time to ROS time, in seconds."""
        return 0.0 if self.simulated else wall_offset_s(self._loop, time)

    def stamp(self, since_epoch_s: float) -> Time:
        """Convert seconds since the epoch to a time message."""
        return RosTimePoint(nanoseconds=round(since_epoch_s * 1e9)).to_msg()

    def advance(self, stamp: Time) -> None:
        """Set simulated time."""
        self.clock.set_ros_time_override(RosTimePoint.from_msg(stamp))
