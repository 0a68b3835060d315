"""Neither bytes on the line nor commands can end an emulator, regardless of the make of its servos."""

import json
import socket
from collections.abc import Callable
from functools import partial
from pathlib import Path
from typing import Any

import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st

from drivers.protocol import v1, v2
from drivers.servos import ax_mx, scs, sts, x
from drivers.servos.register import ServoModel
from drivers.servos.xl320 import XL320
from sim_backend.buses.dynamixel import VirtualDynamixelBus
from sim_backend.buses.feetech import VirtualBus
from sim_backend.control import ControlServer
from sim_backend.eeprom import keep_eeprom
from sim_backend.faults.control import handle_fault_command
from sim_backend.faults.player import FaultPlayer
from sim_backend.faults.targets import FaultTargets
from sim_backend.line.line import ServoLine
from sim_backend.mechanics.plant import BenchPlant
from sim_backend.packets import dynamixel as dynamixel_wire
from sim_backend.packets import sts as sts_wire
from sim_backend.scene.hand import SceneHand, handle_hand_command
from sim_backend.scene.world import World

IDS = (1, 2)
PACKET_S = 0.003

Make = tuple[Callable[[], ServoLine[Any]], st.SearchStrategy[bytes]]


def first(models: dict[str, Any]) -> ServoModel:
    return next(iter(models.values()))


SERVO_ID = st.one_of(st.sampled_from((*IDS, 0xFE)), st.integers(0, 0xFF))
BYTE = st.integers(0, 0xFF)
SIZE = st.one_of(st.integers(0, 20), st.integers(250, 255), BYTE)
PARAMETERS = st.one_of(st.binary(max_size=8), st.binary(max_size=253))
FRAME = st.tuples(BYTE, SIZE).map(bytes)
"""Address and size of a read in protocol 1.0."""
BULK_READ = st.builds(lambda at, size: bytes((0, size, 1, at, size, 2, at)), BYTE, SIZE)
GROUP_HEAD = st.builds(lambda at, size, rest: bytes((at, size)) + rest, BYTE, SIZE, PARAMETERS.map(lambda b: b[:250]))

PACKET_V1 = st.one_of(
    st.builds(v1.packet, SERVO_ID, st.just(sts_wire.Code.READ), FRAME),
    st.builds(v1.packet, SERVO_ID, st.just(sts_wire.Code.BULK_READ), BULK_READ),
    st.builds(v1.packet, SERVO_ID, st.sampled_from(list(sts_wire.Code)), GROUP_HEAD),
    st.builds(v1.packet, SERVO_ID, BYTE, PARAMETERS),
)
WORD = st.one_of(st.integers(0, 700), st.integers(0, 0xFFFF)).map(lambda value: value.to_bytes(2, "little"))
SPAN_V2 = st.builds(lambda at, size, rest: at + size + rest, WORD, WORD, st.binary(max_size=20))
PACKET_V2 = st.one_of(
    st.builds(v2.packet, SERVO_ID, st.just(dynamixel_wire.Code.READ), st.builds(bytes.__add__, WORD, WORD)),
    st.builds(v2.packet, SERVO_ID, st.sampled_from(list(dynamixel_wire.Code)), SPAN_V2),
    st.builds(v2.packet, SERVO_ID, BYTE, PARAMETERS),
)


def line_v1(model: ServoModel) -> Callable[[], ServoLine[Any]]:
    return lambda: VirtualBus.of(BenchPlant(IDS), model)


def line_v2(model: ServoModel) -> Callable[[], ServoLine[Any]]:
    return lambda: VirtualDynamixelBus.of(BenchPlant(IDS), dict.fromkeys(IDS, model))


MAKES: dict[str, Make] = {
    "sts": (line_v1(sts.STS3215), PACKET_V1),
    "scs": (line_v1(first(scs.MODELS)), PACKET_V1),
    "ax": (line_v1(next(m for m in ax_mx.MODELS.values() if not m.bulk_read)), PACKET_V1),
    "mx": (line_v1(next(m for m in ax_mx.MODELS.values() if m.bulk_read)), PACKET_V1),
    "x": (line_v2(x.XL430_W250), PACKET_V2),
    "xl330": (line_v2(x.XL330_M288), PACKET_V2),
    "xl320": (line_v2(XL320), PACKET_V2),
}


@st.composite
def damaged(draw: st.DrawFn, packets: st.SearchStrategy[bytes]) -> bytes:
    """Return a packet with lost or changed bytes, or bytes that are not a packet."""
    data = bytearray(draw(st.one_of(packets, st.binary(max_size=20))))
    for _ in range(draw(st.integers(0, 2))):
        if data:
            at = draw(st.integers(0, len(data) - 1))
            if draw(st.booleans()):
                del data[at]
            else:
                data[at] = draw(st.integers(0, 255))
    return bytes(data)


def talk(line: ServoLine[Any], pieces: list[bytes]) -> None:
    now_s = 1.0
    line.advance(now_s)
    for piece in pieces:
        line.receive(piece, now_s)
        now_s += PACKET_S
        line.advance(now_s)


def conversations(make: str) -> st.SearchStrategy[list[bytes]]:
    packets = MAKES[make][1]
    return st.lists(st.one_of(packets, packets, damaged(packets)), max_size=12)


@pytest.mark.parametrize("make", MAKES)
def test_random_bytes_do_not_end_an_emulator(make: str, tmp_path: Path) -> None:
    @settings(max_examples=50, deadline=None, suppress_health_check=[HealthCheck.too_slow])
    @given(conversations(make))
    def send(pieces: list[bytes]) -> None:
        line = MAKES[make][0]()
        file = tmp_path / "eeprom.yaml"
        file.unlink(missing_ok=True)
        keep_eeprom(file, [line])
        talk(line, pieces)
        keep_eeprom(file, [MAKES[make][0]()])  # the next emulator starts with all values that this one has saved

    send()


@pytest.mark.parametrize("make", ["sts", "scs", "ax", "mx"])
@pytest.mark.parametrize("size", [200, 253, 254, 255])
def test_a_read_that_is_too_long_for_a_reply(make: str, size: int) -> None:
    line = MAKES[make][0]()
    replies = line.receive(v1.packet(1, sts_wire.Code.READ, bytes((0x26, size))), 1.0)
    assert all(reply.data[3] == len(reply.data) - 4 for reply in replies)
    (alive,) = line.receive(v1.packet(1, sts_wire.Code.PING, b""), 2.0)
    assert alive.data == sts_wire.status_packet(1, 0)


@pytest.mark.parametrize(
    "line",
    [
        b"[]",
        b"null",
        b"1",
        b"\xff",
        b"[" * 100_000,
        b'{"do": ["look"]}',
        b'{"do": "move", "joints": ["joint1"], "position": NaN}',
        b'{"do": "move", "joints": ["joint1"], "position": 1e308}',
        b'{"do": "move", "joints": ["joint1"], "position": true}',
        b'{"do": "move", "joints": ["joint1"], "position": 1' + b"0" * 400 + b"}",
        b'{"do": "hold", "joints": 3}',
        b'{"do": "hold", "joints": [["joint1"]]}',
        b'{"do": "connect", "joints": [{}]}',
        b'{"do": "fault", "text": "silent id=' + b"9" * 5000 + b'"}',
        b'{"do": "fault", "text": "\\ud800"}',
        b'{"do": "fault", "text": "silent \'"}',
    ],
    ids=lambda line: line.decode(errors="replace")[:40],
)
def test_random_commands_do_not_end_an_emulator(line: bytes, tmp_path: Path) -> None:
    world = World()
    hand = SceneHand(world, dict.fromkeys(world.joints, 1.0))
    bus = VirtualBus.of(BenchPlant(IDS))
    player = FaultPlayer(FaultTargets({"": bus}))
    handle = partial(handle_fault_command, player, lambda: 0.0, partial(handle_hand_command, hand, world.lay_table))
    with ControlServer(tmp_path / "bus.control", handle) as server, socket.socket(socket.AF_UNIX) as client:
        client.connect(str(server.path))
        client.settimeout(1.0)
        client.sendall(line + b'\n{"do": "look"}\n')
        for _ in range(10):
            server.tick()
        refused, looked, _ = client.recv(1 << 16).split(b"\n")
    assert json.loads(refused)["error"]
    assert json.loads(looked)["joint1"]["held"] is False


def test_a_client_that_never_ends_its_line_is_disconnected(tmp_path: Path) -> None:
    with ControlServer(tmp_path / "bus.control", lambda command: {}) as server, socket.socket(socket.AF_UNIX) as client:
        client.connect(str(server.path))
        client.settimeout(1.0)
        for _ in range(4):
            client.sendall(b"x" * 50_000)
            server.tick()
            if server.clients == 0:
                break
        assert server.clients == 0
