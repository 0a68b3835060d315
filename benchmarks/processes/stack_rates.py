"""Run ``servoloop up`` as a process at one rate, on a bus with transmission delays, for ``benchmarks.rates``, with one
subscriber."""

import os
import random
import subprocess
import sys
import time
from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path
from typing import Final

import psutil

from benchmarks.simulator import TABLE, WRITE, Servos
from drivers.protocol.v1 import BROADCAST_ID, SYNC_WRITE
from drivers.servos import sts
from nodes.clients.client_node import client_node
from nodes.clients.stack_monitor import NewestMessages, StackMonitor
from servoloop.stack.processes import end_with_parent
from servoloop.stack.shipped_files import CONTROLLERS

SERVOS: Final = 7
HAND, HAND_COUNTS = 7, 1100
"""ID of the hand's servo, and a position of this servo between the limits of the fingers, in counts."""
START_S: Final = 60.0
SETTLE_S: Final = 3.0
"""Delay after the start before the measurement begins, in seconds. This startup phase includes first-use costs and
discovery."""
MISSING: Final = ("silent", "corrupt", "late", "no_time", "skipped")
"""A servo's counters of values that were not received in a cycle."""


class StoringServos(Servos):
    """Servos that do not move but store written values, because the stack reads its settings back."""

    def __init__(self, servo_ids: list[int]) -> None:
        super().__init__(servo_ids)
        self._tables = {servo_id: bytearray(TABLE) for servo_id in servo_ids}
        self._stored = b""
        """Last sync write. The stack repeats the goals of an arm at rest in every cycle."""
        for servo_id, table in self._tables.items():
            table[sts.torque_enable.address] = 0
            if servo_id == HAND:
                at = sts.present_position.address
                table[at : at + 2] = HAND_COUNTS.to_bytes(2, "little")

    def answer(self, packet: bytes) -> bytes:
        code, address = packet[4], packet[5]
        if code == WRITE:
            content, asked = packet[6:-1], packet[2]
            self._store(address, dict.fromkeys(self._tables if asked == BROADCAST_ID else {asked}, content))
        elif code == SYNC_WRITE and packet != self._stored:
            size, self._stored = packet[6], packet
            entries = [packet[at : at + size + 1] for at in range(7, len(packet) - 1, size + 1)]
            self._store(address, {entry[0]: entry[1:] for entry in entries})
        return super().answer(packet)

    def _store(self, address: int, contents: Mapping[int, bytes]) -> None:
        for servo_id in contents.keys() & self._tables.keys():
            content = contents[servo_id]
            self._tables[servo_id][address : address + len(content)] = content
        self._kept.clear()

    def _table(self, servo_id: int) -> bytearray:
        return self._tables[servo_id]


@dataclass(frozen=True, slots=True)
class StackFigures:
    """Results of ``servoloop up`` at one rate."""

    cycles: int
    missed: int
    missing: float
    """Fraction of values that were not received in their cycle."""
    cpu_share: float
    thread_shares: tuple[float, ...]
    """Processor time of each thread as a fraction of one core: the main thread, followed by the busiest threads."""
    ready_s: float
    """Time from the start of the process until it was ready for clients, in seconds."""
    memory_bytes: int
    """Resident memory at the end of the run."""


@contextmanager
def stack(device: str, rate_hz: float, folder: Path, domain: int | None = None) -> Iterator[psutil.Process]:
    """Run ``servoloop up`` at a given rate in a ROS domain, ready for clients. The default is a random domain."""
    controllers, ready, log = folder / "controllers.yaml", folder / "ready", folder / "log"
    text = CONTROLLERS.read_text()
    controllers.write_text(text.replace("update_rate: 20", f"update_rate: {rate_hz:g}", 1))
    ready.unlink(missing_ok=True)
    # The domain also applies to the subscriber in this process.
    os.environ["ROS_DOMAIN_ID"] = str(random.randint(1, 100) if domain is None else domain)
    command = [sys.executable, "-m", "servoloop", "up", "--port", device, "--controllers", str(controllers)]
    with log.open("wb") as out:
        process = subprocess.Popen(
            [*command, "--ready-file", str(ready)], stdout=out, stderr=out, preexec_fn=end_with_parent
        )
    try:
        deadline_s = time.monotonic() + START_S
        while not ready.exists():
            if process.poll() is not None or time.monotonic() > deadline_s:
                raise SystemExit(f"servoloop up did not start:\n{log.read_text()}")
            time.sleep(0.05)
        yield psutil.Process(process.pid)
    finally:
        process.terminate()
        process.wait(START_S)


def measure(device: str, rate_hz: float, seconds: float, folder: Path) -> StackFigures:
    """Run the stack at a given rate for a given time, with a subscriber to its states and diagnostics."""
    with stack(device, rate_hz, folder) as process, client_node("benchmark_rates") as (node, executor):
        ready_s = (folder / "ready").stat().st_mtime - process.create_time()
        monitor = StackMonitor(node, executor, "arm_controller")
        _spin(monitor, SETTLE_S)
        before, threads, begin_s = _counts(monitor.newest), _threads(process), time.perf_counter()
        _spin(monitor, seconds)
        after, lasted_s = _counts(monitor.newest), time.perf_counter() - begin_s
        shares = {one: (cpu_s - threads.get(one, 0.0)) / lasted_s for one, cpu_s in _threads(process).items()}
        memory_bytes = process.memory_info().rss
    cycles, missed, missing = (new - old for old, new in zip(before, after, strict=True))
    main = shares.pop(process.pid)
    total = main + sum(shares.values())
    each = (main, *sorted(shares.values(), reverse=True))
    missing_share = missing / max(1, cycles * SERVOS)
    return StackFigures(cycles, missed, missing_share, total, each, ready_s, memory_bytes)


def _spin(monitor: StackMonitor, seconds: float) -> None:
    end_s = time.monotonic() + seconds
    while time.monotonic() < end_s:
        monitor.spin(0.1)
        monitor.newest.samples.clear()


def _counts(newest: NewestMessages) -> tuple[int, int, int]:
    """Return the number of cycles, missed cycles and missing values in the latest diagnostics."""
    loop, servos = newest.loop, newest.diagnostics.values()
    if not loop:
        raise SystemExit("the stack has not published any diagnostics")
    missing = sum(int(values.get(kind, 0)) for values in servos for kind in MISSING)
    return int(loop["cycles"]), int(loop["missed_cycles"]), missing


def _threads(process: psutil.Process) -> dict[int, float]:
    """Return the processor time of each thread in seconds, keyed by thread ID."""
    return {one.id: one.user_time + one.system_time for one in process.threads()}
