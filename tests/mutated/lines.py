"""Send mutated streams to every decoder and to the virtual servos of every make.

A stream fails if a decoder or a servo raises an error.
"""

from collections.abc import Callable
from random import Random
from typing import Final

from servoloop.campaign.invariants.commands.wire_monitor import WireMonitor
from servoloop.simulation.trace_file import PacketText
from servoloop.stack.arm_folders import find_arm, read_arm_servos
from servoloop.stack.emulator import couplings, virtual_lines
from sim_backend.mechanics.plant import WorldPlant
from sim_backend.scene.world import World
from tests.mutated.packets import MAKES, stream

PACKET_S: Final = 0.003
STREAMS_PER_LINE: Final = 500
"""Number of streams after which a new line with factory-new servos is used."""
ARMS: Final = {"sts": "so101", "x": "robot_arm_dynamixel", "xl330": "koch"}
"""An included arm for each make of servo, keyed by make. No included arm has servos of the other makes."""

Hear = Callable[[bytes], object]


def decoders(make: str) -> dict[str, Hear]:
    """Return all functions that decode bytes of a bus: those in the driver, the simulation, traces and campaigns."""
    one = MAKES[make]
    reply = one.packets.ReplyDecoder(6, frozenset(range(256)), 0x80)
    found: dict[str, Hear] = {
        "replies": reply.feed,
        "end of replies": lambda data: (reply.feed(data), reply.finish()),
        "instructions": one.wire.InstructionParser().feed,
    }
    if make == "sts":
        found["instructions of STS"] = one.wire.StsParser().feed
    if make in ARMS:
        files = read_arm_servos(find_arm(ARMS[make]))
        joints = files.robot.joints
        ways = couplings(files.robot)
        (line,) = virtual_lines(files.robot, WorldPlant(World(files.scene), ways)).values()
        text = PacketText(joints)
        found["text of instructions"] = text.sent
        found["text of replies"] = text.received
        found["monitor of campaigns"] = WireMonitor(tuple(joints), line, 0.05).see
    return found


def feed(make: str, hear: Hear, seed: int, count: int) -> None:
    """Feed streams, each in one to three pieces."""
    for number in range(count):
        chance = Random(f"{make}/{seed}/{number}")
        data = stream(MAKES[make], chance)
        ends = sorted(chance.randint(0, len(data)) for _ in range(chance.randrange(3)))
        _told(hear, data, ends, f"{make}, seed {seed}, stream {number}")


def talk(make: str, seed: int, count: int) -> None:
    """Send streams to virtual servos, with time between them."""
    for number in range(count):
        if number % STREAMS_PER_LINE == 0:
            line, now_s = MAKES[make].line(), 1.0
            line.advance(now_s)
        chance = Random(f"{make}/{seed}/{number}")
        data = stream(MAKES[make], chance)
        now_s += chance.choice((0.0, 0.0002, PACKET_S, PACKET_S, 0.03))

        def receive(piece: bytes) -> None:
            line.receive(piece, now_s)  # noqa: B023
            line.advance(now_s + PACKET_S)  # noqa: B023

        _told(receive, data, [], f"{make}, seed {seed}, stream {number}")


def _told(hear: Hear, data: bytes, ends: list[int], which: str) -> None:
    try:
        for begin, end in zip([0, *ends], [*ends, len(data)], strict=True):
            hear(data[begin:end])
    except Exception as error:
        error.add_note(f"{which}: {data.hex(' ')}")
        raise
