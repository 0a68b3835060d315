"""*Move* folder of the page, with buttons that move the arm while they are held."""

import logging
import threading
from collections.abc import Callable
from html import escape
from typing import Any, Final

import viser
from viser._messages import RunJavascriptMessage

from controller.diagnostics import CONTROLLERS
from drivers.clock import Clock
from drivers.driver_errors import DriverError
from servoloop.command_socket.client import CommandClient
from servoloop.dashboard.narrow_page import PINNED
from servoloop.manual.buttons import REPEATS_HZ, Command, GoTo, HeldButtons, Moves, Turn
from servoloop.manual.poses import CLOSE, NO_TARGETS, OPEN, MoveTargets, find_targets
from servoloop.manual.robot import LiveRobot
from servoloop.manual.robot_client import RobotClient
from servoloop.recording.sources import LiveSource

log = logging.getLogger(__name__)
TICK_S: Final = 0.04
POLL_S: Final = 0.2
RETRY_S: Final = 2.0
"""Interval between retries after an error, and between updates of the pose list, in seconds."""
END_S: Final = 8.0
"""Maximum time to wait for the thread to end, in seconds."""
CONNECTING: Final = "waiting for the controllers of the stack"
STOPPED: Final = "All motions of all clients were stopped."


class Handling:
    """Manual motion of the arm, which continues in steps while a button is held."""

    def __init__(self, buttons: HeldButtons) -> None:
        self.message = ""
        self._buttons = buttons
        self._stop = threading.Event()
        self._pid: int | None = None

    def begin(self, pid: int) -> None:
        """Begin a connection to the stack with this process ID. A button that is held now has no effect until it is
        pressed again.

        A requested stop that has not been sent remains if the connection is to the same stack as before.
        """
        self.message = ""
        self._buttons.end()
        if pid != self._pid:
            self._stop.clear()
        self._pid = pid

    def stop(self) -> None:
        """Ignore held buttons and request that all goals be canceled. May be called from any thread."""
        self._buttons.end()
        self._stop.set()

    def step(self, client: Moves) -> None:
        """Stop if requested. Otherwise, continue the motion of the held button by one step.

        After an error, the motion does not resume until a button is pressed again. Raises CommandError if the stop
        could not be sent. The next call then sends the stop again.
        """
        if self._stop.is_set():
            self._stop.clear()
            try:
                client.stop()
            except BaseException:
                self._stop.set()
                raise
            self.message = STOPPED
        command = self._buttons.command()
        if command is None:
            return
        try:
            self.message = command.step(client)
        except DriverError as error:
            self._buttons.end()
            self.message = str(error)


class Mover:
    """Thread that moves the joints of a running stack while buttons are held."""

    def __init__(self, source: LiveSource, clock: Clock) -> None:
        self.buttons = HeldButtons(clock)
        self.targets = NO_TARGETS
        self._why = CONNECTING
        self._source = source
        self._robot = LiveRobot(source)
        self._handling = Handling(self.buttons)
        self.stop = self._handling.stop
        self._ended = threading.Event()
        self._thread = threading.Thread(target=self._run, name="move", daemon=True)
        self._thread.start()

    @property
    def message(self) -> str:
        """Message about the current motion, or the reason why the arm cannot be moved."""
        return self._handling.message if self.targets.joints else self._why

    def close(self) -> None:
        """End the thread. A moving arm comes to rest, because it receives no further commands."""
        self._ended.set()
        self._thread.join(END_S)

    def _run(self) -> None:
        while not self._ended.is_set():
            try:
                self._serve_stack()
            except DriverError as error:
                self._why = str(error)
            except Exception as error:  # an error must not stop the viewer
                log.exception("the arm cannot be moved from the page")
                self._why = f"the arm cannot be moved: {error}"
            self.targets = NO_TARGETS
            self._ended.wait(RETRY_S)

    def _serve_stack(self) -> None:
        """Move the joints of the running stack until the stack ends."""
        self._why = CONNECTING
        if not self._wait_for(lambda: self._source.connected):
            return
        with CommandClient(self._source.stack, "view") as commands:
            self._handling.begin(commands.stack.pid)
            self._serve(RobotClient(commands, self._robot))

    def _serve(self, client: RobotClient) -> None:
        seen: object = None
        turn = 0
        while self._source.connected and not self._ended.is_set():
            self._handling.step(client)
            idle = self.buttons.command() is None
            if idle and turn % round(RETRY_S / TICK_S) == 0:
                active = self._source.robot.state.snapshot.statuses.get(CONTROLLERS)
                if active is None or active.values != seen:
                    client.connect()
                    seen = active.values if active else None
                self._update(find_targets(self._source.folder, client.driven, self._robot.limits))
            if idle:
                client.listen()
            self._ended.wait(TICK_S)
            turn += 1

    def _update(self, now: MoveTargets) -> None:
        if now != self.targets:
            self.targets = now

    def _wait_for(self, ready: Callable[[], bool]) -> bool:
        """Wait until ``ready`` returns True. Return False if the thread has to end first."""
        while not ready():
            if self._ended.wait(POLL_S):
                return False
        return True


NONE: Final = "–"
TURNS: Final = {"Move (−)": -1.0, "Move (+)": 1.0}
SLOWEST: Final = 0.1
NOTICE_S: Final = 8.0
HINT: Final = "Hold a button to move the arm. It stops when you release the button."
TEXT_STYLE: Final = 'style="margin:0.3em 1em;font-size:0.85em;line-height:1.3;height:4em;overflow-y:auto"'
"""Style of the message. The height is fixed, so that a longer message does not move the buttons under the mouse
pointer."""
RELEASE: Final = """
const release = () => document.querySelectorAll("button").forEach(
  (button) => button.dispatchEvent(new PointerEvent("pointercancel", {bubbles: true})));
addEventListener("blur", release);
document.addEventListener("visibilitychange", release);
"""
"""JavaScript that releases all buttons when the page moves to the background, because it may then miss a release
event."""
Button = viser.GuiButtonHandle


class MovePanel:
    """Buttons that move the arm, for all browsers that show the page. The first browser to hold a button has
    control."""

    def __init__(self, server: viser.ViserServer, mover: Mover, order: float) -> None:
        """Add the folder at position ``order`` on the page, and the *Stop everything* button above all folders."""
        self._mover, self._buttons = mover, mover.buttons
        self._targets: MoveTargets | None = None
        gui = self._gui = server.gui
        # viser does not have a public method for this.
        gui._websock_interface.queue_message(RunJavascriptMessage(RELEASE))
        gui.add_html(PINNED, order=-1.0)
        self._stop = gui.add_button("Stop everything", color="red", order=0.0, disabled=True)
        # Viser calls this when the button is pressed, and repeatedly while it is held.
        self._stop.on_hold(self._stopped)
        self._stop.on_click(self._stopped)
        with gui.add_folder("Move", order=order):
            self._text = gui.add_html("")
            self._share = gui.add_slider("Speed", min=SLOWEST, max=1.0, step=SLOWEST, initial_value=0.5)
            self._joint = gui.add_dropdown("Joint", (NONE,))
            turns = [self._button(text, self._turn(way)) for text, way in TURNS.items()]
            self._hand = [self._button(text.capitalize(), self._move_hand(text)) for text in (OPEN, CLOSE)]
            self._pose = gui.add_dropdown("Pose", (NONE,))
            self._go = self._button("Go to the pose", self._selected_pose)
        self._needs_arm = (*turns, *self._hand, self._stop)

    def show(self) -> None:
        """Update the available joints and poses and the message."""
        now = self._mover.targets
        if now is not self._targets:
            self._targets = now
            for button in self._needs_arm:
                button.disabled = not now.joints
            for button in self._hand:
                button.visible = bool(now.hand)
            self._joint.options = now.joints or (NONE,)
            self._pose.options = tuple(now.poses) or (NONE,)
            self._pose.visible = self._go.visible = bool(now.poses)
        lines = "<br>".join(map(escape, (self._mover.message or HINT, *now.refused)))
        content = f"<div {TEXT_STYLE}>{lines}</div>"
        if content != self._text.content:
            self._text.content = content

    def _button(self, label: str, command_of: Callable[[], Command | None]) -> Button:
        button = self._gui.add_button(label)

        # Viser calls coroutines in the receiving thread, in event order.
        async def held(event: viser.GuiEvent[Button]) -> None:
            command = command_of()
            refused = self._buttons.hold((event.client_id, label), command) if command else ""
            if refused and event.client is not None:
                event.client.add_notification("The arm does not move", refused, auto_close_seconds=NOTICE_S)

        async def released(event: viser.GuiEvent[Button]) -> None:
            self._buttons.release((event.client_id, label))

        button.on_hold(held, callback_hz=REPEATS_HZ)
        button.on_click(released)
        return button

    async def _stopped(self, _: Any) -> None:
        self._mover.stop()

    def _turn(self, way: float) -> Callable[[], Command | None]:
        return lambda: Turn(self._joint.value, way * self._speed)

    def _move_hand(self, name: str) -> Callable[[], Command | None]:
        return lambda: self._go_to(name, self._mover.targets.hand)

    def _selected_pose(self) -> Command | None:
        return self._go_to(self._pose.value, self._mover.targets.poses)

    def _go_to(self, name: str, poses: Any) -> Command | None:
        return GoTo(name, poses[name], self._speed) if name in poses else None

    @property
    def _speed(self) -> float:
        """Speed from the slider, which is limited because a browser can send any number, including NaN."""
        return min(1.0, max(SLOWEST, self._share.value))
