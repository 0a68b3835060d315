"""The in-process port: bytes arrive in simulated time, and every run is the same."""

from typing import Any

import pytest

from drivers.driver_errors import PortLost
from drivers.port import Port
from drivers.servos import sts
from sim_backend.buses.feetech import VirtualBus
from sim_backend.buses.port import VirtualPort
from sim_backend.clock import SimulatedClock
from sim_backend.mechanics.plant import BenchPlant
from sim_backend.packets.sts import Code, checksum, status_packet


def packet(servo_id: int, code: int, parameters: bytes = b"") -> bytes:
    body = bytes((servo_id, len(parameters) + 2, code)) + parameters
    return b"\xff\xff" + body + bytes((checksum(body),))


PING = packet(1, Code.PING)


def wire(*servo_ids: int) -> tuple[VirtualPort, SimulatedClock, VirtualBus]:
    clock = SimulatedClock(50.0)
    bus = VirtualBus.of(BenchPlant(servo_ids or (1,)))
    return VirtualPort(bus, clock), clock, bus


def test_a_read_advances_to_the_arrival() -> None:
    port, clock, _ = wire()
    port.write(PING)
    assert clock.now() == 50.0
    assert port.read(6, 50.1) == status_packet(1, 0)
    assert clock.now() == pytest.approx(50.000122)


def test_an_incomplete_read_ends_at_its_deadline() -> None:
    port, clock, _ = wire()
    port.write(PING)
    assert port.read(7, 50.1) == status_packet(1, 0)
    assert clock.now() == 50.1
    assert port.read(1, 50.0) == b""


def test_bytes_after_the_deadline_are_read_later() -> None:
    port, clock, _ = wire()
    port.write(PING)
    assert port.read(6, 50.0001) == b""
    assert clock.now() == 50.0001
    assert port.read(2, 51.0) == b"\xff\xff"
    assert port.read(4, 51.0) == status_packet(1, 0)[2:]


def test_discarding_drops_only_bytes_that_have_arrived() -> None:
    port, clock, _ = wire()
    port.write(PING)
    port.discard_input()
    assert port.read(6, 51.0) == status_packet(1, 0)
    port.write(PING)
    clock.sleep_until(52.0)
    port.discard_input()
    assert port.read(6, 53.0) == b""


@pytest.mark.parametrize("end", ["unplug", "close"])
def test_every_method_raises_after_the_port_is_gone(end: str) -> None:
    port, _, _ = wire()
    getattr(port, end)()
    port.close()
    uses: list[Any] = [
        lambda: port.write(PING),
        lambda: port.read(1, 60.0),
        port.discard_input,
    ]
    for use in uses:
        with pytest.raises(PortLost, match="virtual was"):
            use()


def test_a_virtual_port_is_a_port() -> None:
    port: Port = wire()[0]
    assert (port.name, port.baud) == ("virtual", 1_000_000)


def _transcript() -> tuple[list[bytes], list[float]]:
    """Move three servos as a group for a second, as a control loop does."""
    port, clock, bus = wire(1, 2, 3)
    bus.rig.plant.load_nm[:] = [0.2, -0.4, 0.6]  # type: ignore[attr-defined]
    port.write(packet(0xFE, Code.WRITE, b"\x2a\x00\x08"))
    port.write(packet(0xFE, Code.WRITE, b"\x28\x01"))
    received, times = [], []
    for cycle in range(20):
        goal = (2048 + 15 * cycle).to_bytes(2, "little") + b"\0\0" + (300).to_bytes(2, "little")
        entries = b"".join(bytes((i,)) + goal for i in (1, 2, 3))
        port.write(packet(0xFE, Code.SYNC_WRITE, b"\x2a\x06" + entries))
        port.write(packet(0xFE, Code.SYNC_READ, b"\x38\x08\x01\x02\x03"))
        received.append(port.read(42, clock.now() + 0.02))
        times.append(clock.now())
        clock.sleep_until(50.0 + 0.05 * (cycle + 1))
    return received, times


def test_two_runs_give_the_same_bytes_at_the_same_times() -> None:
    first = _transcript()
    assert first == _transcript()
    assert all(len(burst) == 42 for burst in first[0])
    position = sts.present_position.decode(first[0][-1][5:7], "little")
    assert position == pytest.approx(2048 + 15 * 18, abs=25)
