"""Move the arm from the pose in which a failed job left it to the ready pose, with the hand open."""

from collections.abc import Callable
from time import monotonic
from typing import Final

from rclpy.executors import SingleThreadedExecutor
from rclpy.node import Node

from nodes.pick_place.arm import RosArm
from pick_place.job import JobOutcome
from pick_place.settings import JobSettings

OPEN_S: Final = 1.0
"""Time for the fingers to open and for a released object to settle, in seconds."""
_SPIN_S: Final = 0.05


class Homing:
    """Homing motion through the controllers of the arm and the hand. ``home`` spins ``executor`` in the caller's
    thread."""

    def __init__(self, node: Node, executor: SingleThreadedExecutor, settings: JobSettings) -> None:
        self._settings = settings
        self._arm = RosArm(node, self._settings)
        self._executor = executor

    def home(self, stop: Callable[[], bool]) -> JobOutcome:
        """Open the hand, then move to the ready pose. When ``stop`` returns True, the motion stops or does not
        begin."""
        self._arm.hand(self._settings.hand_open_m)
        opened_s = monotonic() + OPEN_S
        while monotonic() < opened_s and not stop():
            self._executor.spin_once(timeout_sec=_SPIN_S)
        if stop():
            return JobOutcome(False)
        moving = self._executor.create_task(self._arm.move(self._settings.ready_rad))
        while not moving.done():  # The move enforces its own timeouts.
            if stop():
                self._arm.stop()
            self._executor.spin_once(timeout_sec=_SPIN_S)
        outcome: JobOutcome = moving.result()
        return outcome
