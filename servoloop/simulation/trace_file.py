"""A recording as a file: CSV, because spreadsheets, pandas and PlotJuggler open it, one line for each cycle."""

import csv
import io
from collections.abc import Sequence

from hal.joint import Joint
from servoloop.simulation.cycle_recorder import CycleRecord, Recording
from servoloop.simulation.packet_text import PacketText
from sim_backend.faults.text import text_of

SEPARATOR = " | "
"""Between the packets of a cycle."""


def trace_text(recording: Recording, joints: Sequence[Joint]) -> str:
    """The recording as CSV: time, commands, positions, velocities, and in words faults, states and packets.

    Numbers are exact (``float`` reads back what was there): s, rad or m, rad/s or m/s. ``joints``: of the robot file.
    """
    text = io.StringIO()
    rows = csv.writer(text, lineterminator="\n")
    rows.writerow(_header(recording))
    packets = packet_texts(recording, joints)
    for cycle, said in zip(recording.cycles, packets, strict=True):
        rows.writerow((*_numbers(cycle), *_words(cycle), SEPARATOR.join(said)))
    return text.getvalue()


def packet_texts(recording: Recording, joints: Sequence[Joint]) -> list[list[str]]:
    """The packets of each cycle in words: ``>`` was sent by the stack, ``<`` came in, with its time in s."""
    buses = {joint.bus for joint in joints}
    texts = {bus: PacketText([joint for joint in joints if joint.bus == bus]) for bus in sorted(buses)}

    def said(cycle: CycleRecord) -> list[str]:
        found = []
        for packet in cycle.packets:
            line = texts[packet.bus]
            what = f"> {line.sent(packet.data)}" if packet.sent else f"< {line.received(packet.data)}"
            found.append(f"{packet.time_s:.4f} {packet.bus}{' ' if packet.bus else ''}{what}")
        return found

    return [said(cycle) for cycle in recording.cycles]


def _header(recording: Recording) -> list[str]:
    commands = [f"command/{name}" for name in recording.interfaces]
    measured = [f"{what}/{joint}" for what in ("position", "velocity") for joint in recording.joints]
    return ["time_s", *commands, *measured, "faults", "injected", "hardware", "controllers", "packets"]


def _numbers(cycle: CycleRecord) -> list[float]:
    return [cycle.time_s, *cycle.command, *cycle.position, *cycle.velocity]


def _words(cycle: CycleRecord) -> list[str]:
    return [
        "; ".join(f"{joint}: {kind}" for joint, kind in cycle.faults.items()),
        "; ".join(text_of(event) for event in cycle.injected),
        cycle.hardware,
        "; ".join(f"{name}: {state}" for name, state in cycle.controllers.items()),
    ]
