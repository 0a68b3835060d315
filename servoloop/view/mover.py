"""The thread of a page that moves the arm: its ROS client, and what the page's buttons want of it."""

import logging
import threading
from collections.abc import Callable
from typing import TYPE_CHECKING, Final

from controller.diagnostics import CONTROLLERS
from drivers.clock import Clock
from drivers.errors import DriverError
from nodes.ros_environment import RosError, require_ros
from servoloop.handling.offer import NOTHING, Offer, offer
from servoloop.handling.presses import Presses
from servoloop.handling.watched_robot import WatchedRobot
from servoloop.handling.wishes import Moves
from servoloop.live.live_source import LiveSource

if TYPE_CHECKING:
    from nodes.handling.robot_client import RobotClient

log = logging.getLogger(__name__)

TICK_S: Final = 0.04
LOOK_S: Final = 0.2
AGAIN_S: Final = 2.0
"""So long until it tries again what did not work, and until it looks again which poses there are."""
END_S: Final = 8.0
LOOKING: Final = "looking for the stack's controllers under ROS: is ROS_DOMAIN_ID here as it is there?"
STOPPED: Final = "stopped: all motions, everybody's"


class Handling:
    """Does what the buttons want, one little piece of a motion at a time."""

    def __init__(self, presses: Presses) -> None:
        self.said = ""
        self._presses = presses
        self._stop = threading.Event()

    def begin(self) -> None:
        """A stack has come: what was asked of the one before counts no more."""
        self.said = ""
        self._presses.end()
        self._stop.clear()

    def stop(self) -> None:
        """Everything is to stop, from any thread: what is held counts no more, and all goals are cancelled."""
        self._presses.end()
        self._stop.set()

    def step(self, client: Moves) -> None:
        """Stop, or go on a little with what is held; what has failed does not go on by itself."""
        if self._stop.is_set():
            self._stop.clear()
            client.stop()
            self.said = STOPPED
        wish = self._presses.wish()
        if wish is None:
            return
        try:
            self.said = wish.on(client)
        except DriverError as error:
            self._presses.end()
            self.said = str(error)


class Mover:
    """Moves the joints of a running stack while buttons are held; where it cannot, it says why."""

    def __init__(self, source: LiveSource, clock: Clock) -> None:
        self.presses = Presses(clock)
        self.offer = NOTHING
        self._why = LOOKING
        self._source = source
        self._robot = WatchedRobot(source)
        self._handling = Handling(self.presses)
        self.stop = self._handling.stop
        self._ended = threading.Event()
        self._thread = threading.Thread(target=self._run, name="move", daemon=True)
        self._thread.start()

    @property
    def said(self) -> str:
        """What is done, or why nothing can be done."""
        return self._handling.said if self.offer.joints else self._why

    def close(self) -> None:
        """End; what moves rests by itself."""
        self._ended.set()
        self._thread.join(END_S)

    def _run(self) -> None:
        while not self._ended.is_set():
            try:
                require_ros()
                self._serve_stack()
            except (DriverError, RosError) as error:
                self._why = str(error)
            except Exception as error:  # of the middleware: who looks on is not disturbed
                log.exception("nothing can be moved")
                self._why = f"nothing can be moved: {error}"
            self.offer = NOTHING
            self._ended.wait(AGAIN_S)

    def _serve_stack(self) -> None:
        """Move the joints of the stack that runs, until it ends."""
        from nodes.client_node import client_node
        from nodes.handling.robot_client import RobotClient

        if not self._wait_for(lambda: self._source.connected):
            return
        with client_node("servoloop_view") as (node, executor):
            client = RobotClient(node, executor, self._robot)
            self._why = LOOKING
            if self._wait_for(lambda: client.found or not self._source.connected) and self._source.connected:
                self._handling.begin()
                self._serve(client, lambda: executor.spin_once(timeout_sec=TICK_S))

    def _serve(self, client: "RobotClient", spin: Callable[[], None]) -> None:
        seen: object = None
        turn = 0
        while self._source.connected and not self._ended.is_set():
            if self.presses.wish() is None and turn % round(AGAIN_S / TICK_S) == 0:
                active = self._source.watched.state.snapshot.statuses.get(CONTROLLERS)
                if active is None or active.values != seen:
                    client.connect()
                    seen = active.values if active else None
                self._renew(offer(self._source.folder, client.driven, self._robot.limits))
            self._handling.step(client)
            spin()
            turn += 1

    def _renew(self, now: Offer) -> None:
        if now != self.offer:
            self.offer = now

    def _wait_for(self, ready: Callable[[], bool]) -> bool:
        """Whether it came before the end."""
        while not ready():
            if self._ended.wait(LOOK_S):
                return False
        return True
