"""What a person sees while they lead: what the follower does and why, both arms' joints, faults by name."""

from collections.abc import Sequence

import numpy as np
from rich.console import Group
from rich.table import Table
from rich.text import Text

from controller.teleop.leader_follower_controller import Phase
from servoloop.handling.live_table import LiveTable
from servoloop.teleop.arms import Teleop

STYLES = {Phase.HOLDING: "yellow", Phase.JOINING: "cyan", Phase.FOLLOWING: "green"}


class Screen(LiveTable):
    """Shows both arms."""

    summary = ""
    """Of the whole, for its end."""

    def show(self, both: Teleop) -> None:
        """Show how it stands now."""
        self.summary = f"{both.loop.figures.summary}; {both.latency.summary}"
        phase = both.controller.phase
        self.draw(said(both), lambda: Group(Text(phase, style=STYLES[phase]), _table(both)))


def said(both: Teleop) -> str:
    """What the follower does, and what is wrong, in one line."""
    controller, state = both.controller, both.latency.state
    faults = [fault.text for fault in state.faults.values() if fault.text != controller.reason] if state else []
    reasons = [reason for reason in (controller.reason, *dict.fromkeys(faults)) if reason]
    return "; ".join([controller.phase, *reasons])


def _table(both: Teleop) -> Table:
    table = Table("joint", "leader", "follower", "error")
    state, command = both.latency.state, both.loop.command
    if state is None:
        return table
    where = dict(zip(both.loop.hardware.joints, state.position.tolist(), strict=True))
    for name, leader, told in _rows(both, command.tolist()):
        error = told - where[name]
        style = "red" if name in state.faults or leader in state.faults else ""
        table.add_row(name, f"{where[leader]:+.3f}", f"{where[name]:+.3f}", f"{error:+.3f}", style=style)
    return table


def _rows(both: Teleop, command: Sequence[float]) -> list[tuple[str, str, float]]:
    told = dict(zip(both.loop.hardware.command_interfaces, command, strict=True))
    return [(one.joint, one.leader, told.get(f"{one.joint}/position", np.nan)) for one in both.controller.joints]
