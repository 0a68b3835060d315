"""Write recorded cycles as CSV, one line per cycle, for spreadsheets, pandas and PlotJuggler."""

import csv
import io
from collections.abc import Iterable, Sequence

from drivers.protocol import v1, v2
from drivers.protocol.decoder import Reply
from drivers.servos.catalog import series_of, wire_protocol
from hal.joint import Joint
from servoloop.simulation.cycle_recorder import CycleRecord, CycleRecording
from sim_backend.faults.text import text_of
from sim_backend.packets import dynamixel as dynamixel_wire
from sim_backend.packets import sts as sts_wire
from sim_backend.packets.instructions import Instruction

ANY_SIZE = frozenset(range(1, 256))
"""Number of data bytes allowed in a reply."""


class PacketText:
    """Converter that formats the packets of one bus as text. Packets must be passed in order."""

    def __init__(self, joints: Iterable[Joint]) -> None:
        """``joints`` are the joints with a servo on the bus; there must be at least one."""
        models = {joint.servo_id: joint.model for joint in joints}
        self._registers = {r.address: r.name for model in models.values() for r in series_of(model).registers}
        self._v1 = wire_protocol(models).packets is v1
        self._wire = sts_wire if self._v1 else dynamixel_wire
        self._parser = self._wire.InstructionParser()
        self._decoder = v1.ReplyDecoder(0, ANY_SIZE) if self._v1 else v2.ReplyDecoder(0, ANY_SIZE)

    def sent(self, data: bytes) -> str:
        """Format one write by the stack as text."""
        found = [self._instruction(one) for one in self._parser.feed(data)]
        return "; ".join(found) if found and not self._parser.pending else data.hex(" ")

    def received(self, data: bytes) -> str:
        """Format one read as text, including the raw bytes if they are not all valid replies."""
        replies = self._decoder.feed(data)
        texts = [_reply(reply) for reply in replies]
        texts += [f"broken reply of {servo_id}" for servo_id in self._decoder.corrupt_ids]
        if self._decoder.garbage or any(reply.garbage for reply in replies) or not texts:
            texts.append(data.hex(" "))
        self._decoder.corrupt_ids.clear()
        self._decoder.garbage = 0
        return "; ".join(texts)

    def _instruction(self, one: Instruction) -> str:
        codes = {int(code): code.name for code in self._wire.Code}
        name, size = codes.get(one.code, f"0x{one.code:02x}"), 1 if self._v1 else 2
        to = "all" if one.servo_id == self._wire.BROADCAST else str(one.servo_id)
        if name not in ("READ", "WRITE", "REG_WRITE", "SYNC_READ", "SYNC_WRITE", "FAST_SYNC_READ"):
            return f"{name} {to} {one.parameters.hex()}".rstrip()
        address, rest = int.from_bytes(one.parameters[:size], "little"), one.parameters[size:]
        place = f"{name} {self._registers.get(address, address)}"
        if name in ("WRITE", "REG_WRITE"):
            return f"{place} {to}={rest.hex()}"
        count, rest = int.from_bytes(rest[:size], "little"), rest[size:]
        if name == "READ":
            return f"{place}[{count}] {to}"
        if name == "SYNC_WRITE":
            entries = [rest[at : at + count + 1] for at in range(0, len(rest), count + 1)]
            return f"{place} {' '.join(f'{entry[0]}={entry[1:].hex()}' for entry in entries)}"
        return f"{place}[{count}] {' '.join(map(str, rest))}"


def _reply(reply: Reply) -> str:
    error = f" error {reply.error:02x}" if reply.error else ""
    return f"{reply.servo_id}:{error} {reply.data.hex()}"


SEPARATOR = " | "
"""Separator between the packets of a cycle."""


def trace_text(recording: CycleRecording, joints: Sequence[Joint]) -> str:
    """Return a recording as CSV: time, commands, positions, velocities, faults, states and packets.

    Numbers are exact, in s, rad or m, and rad/s or m/s. ``joints`` are the joints of the robot file.
    """
    text = io.StringIO()
    rows = csv.writer(text, lineterminator="\n")
    rows.writerow(_header(recording))
    packets = packet_texts(recording, joints)
    for cycle, texts in zip(recording.cycles, packets, strict=True):
        rows.writerow((*_numbers(cycle), *_words(cycle), SEPARATOR.join(texts)))
    return text.getvalue()


def packet_texts(recording: CycleRecording, joints: Sequence[Joint]) -> list[list[str]]:
    """Format the packets of each cycle as text, with their times in seconds. ``>`` marks sent packets, and ``<`` marks
    received packets."""
    buses = {joint.bus for joint in joints}
    texts = {bus: PacketText([joint for joint in joints if joint.bus == bus]) for bus in sorted(buses)}

    def cycle_texts(cycle: CycleRecord) -> list[str]:
        found = []
        for packet in cycle.packets:
            bus = recording.buses[packet.port]
            line = texts[bus]
            content = f"> {line.sent(packet.data)}" if packet.sent else f"< {line.received(packet.data)}"
            found.append(f"{packet.stamp_s:.4f} {bus}{' ' if bus else ''}{content}")
        return found

    return [cycle_texts(cycle) for cycle in recording.cycles]


def _header(recording: CycleRecording) -> list[str]:
    commands = [f"command/{name}" for name in recording.interfaces]
    measured = [f"{kind}/{joint}" for kind in ("position", "velocity") for joint in recording.joints]
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
