"""Guide a person at a terminal through a calibration with instructions, a live table and questions."""

from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from math import degrees
from typing import TYPE_CHECKING, Self

from rich.live import Live
from rich.table import Table
from rich.text import Text

from commissioning.calibrate.result import unit
from commissioning.calibrate.run import STORE
from commissioning.slow_arm import StoppedError
from servoloop.commands.shared.console import Keyboard, text_console
from servoloop.stack.signals import Signals
from servoloop.stack.tables import print_table

if TYPE_CHECKING:
    from commissioning.calibrate.by_hand import CalibrationTask
    from commissioning.calibrate.run import CalibrationDifference

NOTHING, STORED = "nothing was stored", "the calibration is stored, but it was not tested"


class Terminal:
    """Dialog with the person who performs the calibration. The dialog uses stderr, so that stdout contains only the
    result."""

    def __init__(self, signals: Signals, yes: bool) -> None:
        """Start the dialog. If ``yes`` is True, no confirmation is requested."""
        self.console = text_console(stderr=True, highlight=False)
        self._signals = signals
        self._keyboard = Keyboard(signals, NOTHING)
        self._yes = yes

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *_: object) -> None:
        """Restore the terminal."""
        self._keyboard.whole_lines()

    def say(self, text: str) -> None:
        """Print a line."""
        self.console.print(Text.assemble(("· ", "dim"), text), soft_wrap=True)

    def until_done(self, task: "CalibrationTask", update: Callable[[], None]) -> None:
        """Show the instruction and the positions of all joints until Enter is pressed."""
        self.console.print(Text.assemble((task.text, "bold"), "; press Enter when done"), soft_wrap=True)
        with self._table() as show:
            while self._keyboard.line() is None:
                update()
                show(task)

    @contextmanager
    def _table(self) -> Iterator[Callable[["CalibrationTask"], None]]:
        if not self.console.is_terminal:
            yield lambda task: None
            return
        with Live(console=self.console, refresh_per_second=10, transient=True) as live:
            yield lambda task: live.update(_sweep_table(task))

    def confirm(self, question: str) -> bool:
        """Ask for confirmation, or return True without asking if ``yes`` was set."""
        if self._yes:
            self.say(f"{question} yes")
        agreed = self._yes or self._keyboard.agrees(question)
        if question == STORE and agreed:
            self._keyboard.left = STORED
        return agreed

    def moved_so(self, joint: str, text: str) -> bool:
        """Ask whether a joint first moved in the direction that ``text`` describes.

        Raises StoppedError if a key was pressed before the question. Enter alone is not accepted: the user may have
        meant to stop the arm, and a wrong answer would reverse the direction of the joint.
        """
        if self._keyboard.pressed():  # The key was pressed after the last cycle of the motion.
            raise StoppedError("stopped; the arm's torque is off")
        question = f"{joint} moved in one direction and back. Was the first direction: {text}?"
        return self._keyboard.agrees(question, enter_is_no=False)

    def show(self, differences: "Sequence[CalibrationDifference]") -> None:
        """Print the new calibration next to the previous one."""
        print_table(self.console, difference_table(differences), "joint", "zero", "homing offset")
        for one in differences:
            if one.doubt:
                self.console.print(f"! {one.joint}: {one.doubt}", style="yellow", soft_wrap=True)

    def stopped(self) -> int:
        """Return the number of requests to stop: the number of signals received, or 1 if only a key was pressed."""
        return self._signals.count or int(self._keyboard.pressed())


def _sweep_table(task: "CalibrationTask") -> Table:
    prefix = common_prefix([joint.name for joint in task.sweep.joints])
    table = Table(f"{prefix}…" if prefix else "joint", "servo", "counts", "minimum", "maximum", "covered")
    for joint in task.sweep.joints:
        name = joint.name.removeprefix(prefix)
        swept = task.sweep.swept.get(joint.name)
        style = "bold" if joint.name in task.joints else "dim"
        if swept is None:
            table.add_row(name, str(joint.servo_id), task.sweep.missing.get(joint.name, ""), style=style)
            continue
        share = swept.travel.span * unit(joint) / (joint.limits.upper - joint.limits.lower)
        numbers = (swept.counts, swept.lower, swept.upper)
        table.add_row(name, str(joint.servo_id), *map(str, numbers), f"{share:.0%}", style=style)
    return table


def difference_table(differences: "Sequence[CalibrationDifference]") -> Table:
    """Return a table of each joint's previous and new sign, zero and offset, its travel and its URDF range."""
    prefix = common_prefix([one.joint for one in differences])
    table = Table(f"{prefix}…" if prefix else "joint", "servo", "sign", "zero", "homing offset")
    for title in ("zero moved", "zero within", "travel", "URDF range"):
        table.add_column(title)
    for one in differences:
        before, made = one.before, one.made
        prismatic = before.unit == "m"
        travel, range_ = made.travel(before), before.limits.upper - before.limits.lower
        table.add_row(
            one.joint.removeprefix(prefix),
            str(one.servo_id),
            _changed(before.sign, made.sign),
            _changed(before.zero_counts, made.zero_counts),
            _changed(before.homing_offset, made.homing_offset),
            f"{one.zero_moved:+.4f} m" if prismatic else f"{degrees(one.zero_moved):+.2f}°",
            f"±{one.uncertainty:.4f} m" if prismatic else f"±{one.uncertainty:.3f} rad",
            f"{travel:.4f} m" if prismatic else f"{travel:.3f} rad",
            f"{range_:.4f} m" if prismatic else f"{range_:.3f} rad",
        )
    return table


def common_prefix(joints: Sequence[str]) -> str:
    """Return the common prefix of the joint names, such as ``left_`` for one of two arms, or an empty string if there
    is none."""
    first = joints[0]
    heads = (first[: end + 1] for end, letter in enumerate(first) if letter == "_")
    return max((head for head in heads if all(name.startswith(head) for name in joints[1:])), key=len, default="")


def _changed(before: int | None, now: int | None) -> str:
    if before == now or before is None:
        return "-" if now is None else str(now)
    return f"{before} → {now}"
