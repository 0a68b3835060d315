"""The virtual bus on a pseudo-terminal with the unchanged official SDK, in real time."""

import contextlib
import importlib
import os
import signal
import subprocess
import sys
import termios
import time
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

import pytest

from drivers.clock import MonotonicClock
from drivers.driver_errors import PortBusy, PortError
from drivers.servos import sts
from sim_backend.buses.feetech import VirtualBus
from sim_backend.buses.pty_link import PtyAdapter, PtyLink
from sim_backend.clock import SimulatedClock
from sim_backend.emulator import LONGEST_CATCH_UP_S, Emulator, serve
from sim_backend.mechanics.plant import BenchPlant

# Imported by name, because the SDK has no type hints.
sdk: Any = importlib.import_module("scservo_sdk")
ROOT = Path(__file__).resolve().parents[2]
IDS = (1, 2, 3)

EMULATE = """
import signal, sys
from pathlib import Path
from sim_backend.buses.feetech import VirtualBus
from sim_backend.emulator import serve
from sim_backend.mechanics.plant import BenchPlant
ended = []
signal.signal(signal.SIGTERM, lambda *_: ended.append(1))
serve(VirtualBus.of(BenchPlant((1, 2, 3))), Path(sys.argv[1]), stop=lambda: bool(ended))
"""


def eventually(what: Callable[[], object], within_s: float = 20.0) -> None:
    """Poll until ``what()`` returns True. The limit only stops a test that fails; it is not a measurement."""
    deadline_s = time.monotonic() + within_s
    while not what():
        assert time.monotonic() < deadline_s, "the condition was never true"
        time.sleep(0.01)


@pytest.fixture
def link(tmp_path: Path) -> Iterator[Path]:
    path = tmp_path / "bus"
    environment = {**os.environ, "PYTHONPATH": str(ROOT)}
    emulator = subprocess.Popen([sys.executable, "-c", EMULATE, str(path)], env=environment)
    try:
        eventually(path.exists)
        yield path
        emulator.send_signal(signal.SIGTERM)
        assert emulator.wait(20) == 0
        assert not path.is_symlink()
    finally:
        emulator.kill()
        emulator.wait()


class Client:
    """Classes of the official SDK that use the port ``link``. Requests whose replies a busy machine loses are sent
    again.

    The SDK waits 34 ms. If the emulator is delayed for longer, its reply arrives after the next instruction. The SDK
    then takes the empty reply to a ping or a write for the reply to a read, and fails because values are missing.
    """

    def __init__(self, link: Path) -> None:
        self.port = sdk.PortHandler(str(link))
        self.handler = sdk.protocol_packet_handler()
        assert self.port.openPort()

    def answer(self, ask: Callable[[], tuple[Any, ...]]) -> Any:
        answers: list[tuple[Any, ...]] = []

        def answered() -> bool:
            self.port.ser.reset_input_buffer()
            with contextlib.suppress(IndexError):
                answers.append(ask())
                return bool(answers[-1][-2] == sdk.COMM_SUCCESS)
            return False

        eventually(answered)
        return answers[-1][0]

    def position(self, servo_id: int) -> int:
        read = self.handler.read2ByteTxRx
        return int(self.answer(lambda: read(self.port, servo_id, 56)))


@pytest.fixture
def client(link: Path) -> Iterator[Client]:
    client = Client(link)
    yield client
    client.port.closePort()


def test_clients_come_and_go(link: Path) -> None:
    for _ in range(3):
        client = Client(link)
        assert client.position(1) == pytest.approx(2048, abs=2)
        client.port.closePort()


def test_another_baud_rate_is_accepted_but_gets_no_reply(client: Client) -> None:
    assert client.port.setBaudRate(250_000)
    assert client.handler.ping(client.port, 1)[1] == sdk.COMM_RX_TIMEOUT
    assert client.port.setBaudRate(1_000_000)
    assert client.position(1) == pytest.approx(2048, abs=2)


def test_a_client_that_hangs_up_does_not_end_the_emulator(client: Client) -> None:
    """Setting baud rate 0 hangs up the terminal."""
    terminal = client.port.ser.fileno()
    settings = termios.tcgetattr(terminal)
    rates, settings[4:6] = settings[4:6], [termios.B0, termios.B0]
    termios.tcsetattr(terminal, termios.TCSANOW, settings)
    assert client.handler.ping(client.port, 1)[1] == sdk.COMM_RX_TIMEOUT
    settings[4:6] = rates
    termios.tcsetattr(terminal, termios.TCSANOW, settings)
    assert client.position(1) == pytest.approx(2048, abs=2)


def test_a_second_emulator_is_refused_with_a_reason(link: Path) -> None:
    with pytest.raises(PortBusy, match="stop that emulator"):
        serve(VirtualBus.of(BenchPlant(IDS)), link, stop=lambda: True)


def test_the_link_of_an_ended_emulator_is_taken_over(tmp_path: Path) -> None:
    link = tmp_path / "bus"
    link.symlink_to(tmp_path / "gone")
    ready: list[Path] = []
    serve(
        VirtualBus.of(BenchPlant(IDS)),
        link,
        stop=lambda: True,
        on_ready=lambda: ready.append(link.readlink()),
    )
    assert ready[0].parts[1] == "dev"
    assert not link.is_symlink()


def test_other_files_at_the_link_are_left_alone(tmp_path: Path) -> None:
    link = tmp_path / "bus"
    link.write_text("mine")
    with pytest.raises(PortBusy, match="choose another path"):
        PtyLink(link)
    assert link.read_text() == "mine"
    with pytest.raises(PortError, match="not a folder"):
        PtyLink(tmp_path / "nowhere" / "bus")


def test_a_link_that_was_replaced_meanwhile_is_not_removed(tmp_path: Path) -> None:
    link = tmp_path / "bus"
    with PtyLink(link):
        link.unlink()
        link.write_text("mine")
    assert link.read_text() == "mine"


@pytest.mark.parametrize("name", ["folder/bus", ".", "..", "x" * 300], ids=["slash", "dot", "dots", "long"])
def test_an_adapter_stays_unplugged_if_its_new_name_is_impossible(
    tmp_path: Path, caplog: pytest.LogCaptureFixture, name: str
) -> None:
    with PtyAdapter(tmp_path / "bus") as adapter:
        adapter.plug(name)
        assert adapter.line is None and "the adapter cannot be plugged in again: " in caplog.text
        adapter.plug()
        assert adapter.line is not None


def test_the_line_accepts_any_baud_rate(tmp_path: Path) -> None:
    with PtyLink(tmp_path / "bus") as line:
        assert line.baud == 1_000_000
        for baud in sts.BAUD_RATES:
            line.baud = baud
            assert line.baud == baud


def test_time_lost_in_a_stall_is_skipped(tmp_path: Path) -> None:
    clock = SimulatedClock()
    bus = VirtualBus.of(BenchPlant(IDS))
    with PtyLink(tmp_path / "bus") as line:
        emulator = Emulator(bus, line, clock)
        clock.sleep_until(7.0)
        emulator.turn()
    assert bus.dropped_s == pytest.approx(7.0 - LONGEST_CATCH_UP_S)


def test_replies_without_a_listener_are_dropped(tmp_path: Path) -> None:
    with PtyLink(tmp_path / "bus") as line:
        for _ in range(100):
            line.write(bytes(4096))
        assert line.read() == b""


def test_ticks_are_called_until_stop(tmp_path: Path) -> None:
    ticks: list[float] = []
    serve(
        VirtualBus.of(BenchPlant(IDS)),
        tmp_path / "bus",
        stop=lambda: len(ticks) >= 3,
        on_tick=ticks.append,
        clock=MonotonicClock(),
    )
    assert ticks == sorted(ticks)


def test_a_tick_reports_the_time_of_the_world(tmp_path: Path) -> None:
    """If the process is delayed after a physics step, ``on_tick`` must still receive the time that the physics has
    reached."""
    bus, clock = VirtualBus.of(BenchPlant(IDS)), MonotonicClock()
    begin_s = clock.now()
    seen: list[tuple[float, float]] = []

    def look(reached_s: float) -> None:
        seen.append((reached_s, bus.reached_s))

    serve(bus, tmp_path / "bus", stop=lambda: len(seen) >= 20, on_tick=look, clock=clock)
    assert all(told_s == reached_s for told_s, reached_s in seen)
    assert begin_s <= seen[0][0] < seen[-1][0] <= clock.now()
