"""The folder *Move* of the page: buttons that move the arm as long as they are held."""

from collections.abc import Callable
from html import escape
from typing import Any, Final

import viser
from viser._messages import RunJavascriptMessage

from servoloop.handling.offer import CLOSE, OPEN, Offer
from servoloop.handling.presses import REPEATS_HZ
from servoloop.handling.wishes import GoTo, Turn, Wish
from servoloop.view.mover import Mover
from servoloop.view.narrow_page import PINNED

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
