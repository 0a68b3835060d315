"""The arm brought home with an open hand: from where a job that failed has left it, to where the next one begins."""

from collections.abc import Callable
from time import monotonic
from typing import Final

from rclpy.executors import SingleThreadedExecutor
from rclpy.node import Node

from nodes.pick_place.arm import RosArm
from nodes.pick_place.job import Outcome
from nodes.pick_place.settings import Settings

OPEN_S: Final = 1.0
"""For the fingers to open, and for what they held to come to rest."""
_SPIN_S: Final = 0.05


class Homing:
    """Uses the arm's and the hand's controllers as the pick-place node does. The caller's thread spins ``executor``."""

    def __init__(self, node: Node, executor: SingleThreadedExecutor, settings: Settings) -> None:
        self._settings = settings
        self._arm = RosArm(node, self._settings)
        self._executor = executor

    def home(self, stop: Callable[[], bool]) -> Outcome:
        """Open the hand, then move to the ready pose. ``stop`` becoming true ends the motion."""
        self._arm.hand(self._settings.hand_open_m)
        opened_s = monotonic() + OPEN_S
        while monotonic() < opened_s and not stop():
            self._executor.spin_once(timeout_sec=_SPIN_S)
        moving = self._executor.create_task(self._arm.move(self._settings.ready_rad))
        while not moving.done():  # the motion has time-outs of its own
            if stop():
                self._arm.stop()
            self._executor.spin_once(timeout_sec=_SPIN_S)
        outcome: Outcome = moving.result()
        return outcome
