"""The folder *Move* of the page: buttons that move the arm as long as they are held."""

import logging
import threading
from collections.abc import Callable
from html import escape
from typing import TYPE_CHECKING, Any, Final

import viser
from viser._messages import RunJavascriptMessage

from controller.diagnostics import CONTROLLERS
from drivers.clock import Clock
from drivers.errors import DriverError
from nodes.ros_environment import RosError, require_ros
from servoloop.dashboard.narrow_page import PINNED
from servoloop.manual.buttons import REPEATS_HZ, GoTo, Moves, Presses, Turn, Wish
from servoloop.manual.poses import CLOSE, NOTHING, OPEN, Offer, offer
from servoloop.manual.robot import LiveRobot
from servoloop.recording.sources import LiveSource

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
        self._robot = LiveRobot(source)
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
                active = self._source.robot.state.snapshot.statuses.get(CONTROLLERS)
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


NONE: Final = "–"
TURNS: Final = {"Turn back (−)": -1.0, "Turn on (+)": 1.0}
SLOWEST: Final = 0.1
NOTICE_S: Final = 8.0
HINT: Final = "Hold a button: the arm moves as long as you do."
SAID: Final = 'style="margin:0.3em 1em;font-size:0.85em;line-height:1.3;height:4em;overflow-y:auto"'
"""Always as high: no button moves away under the mouse because a text grows."""
LET_GO: Final = """
const letGo = () => document.querySelectorAll("button").forEach(
  (button) => button.dispatchEvent(new PointerEvent("pointercancel", {bubbles: true})));
addEventListener("blur", letGo);
document.addEventListener("visibilitychange", letGo);
"""
"""A page that is not in front may not hear that a button is let go: it lets go by itself. Viser has no other way."""
Button = viser.GuiButtonHandle


class MovePanel:
    """Buttons of all browsers that have the page open; the first who holds one moves the arm."""

    def __init__(self, server: viser.ViserServer, mover: Mover, order: float) -> None:
        """``order``: where in the page the folder is; *Stop everything* is above all folders."""
        self._mover, self._presses = mover, mover.presses
        self._offer: Offer | None = None
        gui = self._gui = server.gui
        gui._websock_interface.queue_message(RunJavascriptMessage(LET_GO))
        gui.add_html(PINNED, order=-1.0)
        self._stop = gui.add_button("Stop everything", color="red", order=0.0, disabled=True)
        self._stop.on_hold(self._stopped)  # at once, and again as long as it is held
        self._stop.on_click(self._stopped)
        with gui.add_folder("Move", order=order):
            self._said = gui.add_html("")
            self._share = gui.add_slider("Speed", min=SLOWEST, max=1.0, step=SLOWEST, initial_value=0.5)
            self._joint = gui.add_dropdown("Joint", (NONE,))
            turns = [self._button(text, self._turn(way)) for text, way in TURNS.items()]
            self._hand = [self._button(text.capitalize(), self._reach(text)) for text in (OPEN, CLOSE)]
            self._pose = gui.add_dropdown("Pose", (NONE,))
            self._go = self._button("Go to the pose", self._wished_pose)
        self._needs_arm = (*turns, *self._hand, self._stop)

    def show(self) -> None:
        """Renew what is offered and said, where it has changed."""
        now = self._mover.offer
        if now is not self._offer:
            self._offer = now
            for button in self._needs_arm:
                button.disabled = not now.joints
            for button in self._hand:
                button.visible = bool(now.hand)
            self._joint.options = now.joints or (NONE,)
            self._pose.options = tuple(now.poses) or (NONE,)
            self._pose.visible = self._go.visible = bool(now.poses)
        lines = "<br>".join(map(escape, (self._mover.said or HINT, *now.refused)))
        content = f"<div {SAID}>{lines}</div>"
        if content != self._said.content:
            self._said.content = content

    def _button(self, label: str, wish: Callable[[], Wish | None]) -> Button:
        button = self._gui.add_button(label)

        async def held(event: viser.GuiEvent[Button]) -> None:  # in order, in the thread that receives
            wanted = wish()
            refused = self._presses.hold((event.client_id, label), wanted) if wanted else ""
            if refused and event.client is not None:
                event.client.add_notification("Nothing moves", refused, auto_close_seconds=NOTICE_S)

        async def released(event: viser.GuiEvent[Button]) -> None:
            self._presses.release((event.client_id, label))

        button.on_hold(held, callback_hz=REPEATS_HZ)
        button.on_click(released)
        return button

    async def _stopped(self, _: Any) -> None:
        self._mover.stop()

    def _turn(self, way: float) -> Callable[[], Wish | None]:
        return lambda: Turn(self._joint.value, way * self._speed)

    def _reach(self, name: str) -> Callable[[], Wish | None]:
        return lambda: self._go_to(name, self._mover.offer.hand)

    def _wished_pose(self) -> Wish | None:
        return self._go_to(self._pose.value, self._mover.offer.poses)

    def _go_to(self, name: str, poses: Any) -> Wish | None:
        return GoTo(name, poses[name], self._speed) if name in poses else None

    @property
    def _speed(self) -> float:
        """Whatever a browser has sent; also where it is no number."""
        return min(1.0, max(SLOWEST, self._share.value))
