"""ROS time as a stack's nodes have it: the machine's, or the loop's where that is simulated."""

from time import time

from builtin_interfaces.msg import Time
from rclpy.clock import ROSClock
from rclpy.time import Time as RosTimePoint
from rclpy.time_source import TimeSource

from drivers.clock import Clock, wall_offset_s


class RosTime:
    """One for all nodes of a stack. Simulated time is what ``advance`` says; nobody has to hear /clock for it."""

    def __init__(self, loop: Clock, simulated: bool) -> None:
        self.clock = ROSClock()
        self.simulated = simulated
        self._loop = loop
        if simulated:
            source = TimeSource()  # of no node: it subscribes to nothing
            source.attach_clock(self.clock)
            source.ros_time_is_active = True
            self.advance(self.stamp(loop.now()))

    def offset_s(self) -> float:
        """Return the seconds to add to the loop's time for ROS time."""
        return 0.0 if self.simulated else wall_offset_s(self._loop, time)

    def stamp(self, since_epoch_s: float) -> Time:
        """A moment as a message."""
        return RosTimePoint(nanoseconds=round(since_epoch_s * 1e9)).to_msg()

    def advance(self, stamp: Time) -> None:
        """Set simulated time."""
        self.clock.set_ros_time_override(RosTimePoint.from_msg(stamp))
