"""Qualities of service that several nodes share."""

from typing import Final

from rclpy.duration import Duration
from rclpy.qos import DurabilityPolicy, HistoryPolicy, QoSProfile, ReliabilityPolicy

LATCHED: Final = QoSProfile(depth=1, durability=DurabilityPolicy.TRANSIENT_LOCAL)
"""A publisher's, as upstream's: a late listener gets the newest message at once."""
LATCHED_WHILE_NEW: Final = QoSProfile(depth=1, durability=LATCHED.durability, lifespan=Duration(seconds=0.5))
"""The same for what is published to listeners only: the newest may be one for a listener of long ago."""
ANY_CLIENT: Final = QoSProfile(depth=10, reliability=ReliabilityPolicy.BEST_EFFORT)
"""A listener's, as upstream's: who publishes best effort is heard too, and the next command makes up for a lost one."""
EVERY_CALL: Final = QoSProfile(depth=1, history=HistoryPolicy.KEEP_ALL)
"""A service's: no call of a burst is lost."""
