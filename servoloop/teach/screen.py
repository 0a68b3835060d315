"""Display the state of the arm, its joints and its faults during a recording or playback."""

import sys
from collections.abc import Callable, Sequence
from contextlib import ExitStack
from typing import Self

from rich.console import Console, Group
from rich.table import Table
from rich.text import Text

from hal.types import JointState
from servoloop.manual.live_table import LiveTable
from servoloop.stack.terminal import raw_keys, typed
from servoloop.teach.arm import TeachArm


class TeachScreen(LiveTable):
    """Live table of one arm."""

    def show(self, phase: str, arm: TeachArm) -> None:
        """Display the current state."""
        state = arm.loop.manager.cycle.seen
        faults = [fault.text for fault in state.faults.values()] if state else []
        text = "; ".join([phase, *dict.fromkeys(faults)])
        self.draw(text, lambda: Group(Text(phase, style="cyan"), _table(arm, state)))


class Teacher(TeachScreen):
    """Terminal user interface of a recording."""

    def __init__(self, console: Console, confirm: Callable[[str], None]) -> None:
        super().__init__(console)
        self.confirm = confirm
        self._raw = ExitStack()

    def __enter__(self) -> Self:
        if sys.stdin.isatty():
            self._raw.enter_context(raw_keys())
        return super().__enter__()

    def __exit__(self, *_: object) -> None:
        super().__exit__()
        self._raw.close()

    def pressed(self) -> Sequence[str]:
        """Return the keys pressed since the last call.

        Without a terminal, input is read by line, and the end of the input counts as q.
        """
        return typed(0.0)


def _table(arm: TeachArm, state: JointState | None) -> Table:
    table = Table("joint", "measured", "commanded")
    if state is None:
        return table
    for name, position, command in zip(arm.joints, state.position.tolist(), arm.loop.command.tolist(), strict=True):
        table.add_row(name, f"{position:+.3f}", f"{command:+.3f}", style="red" if name in state.faults else "")
    return table
