"""Streams of packets of every make, such as a careless or hostile program might send."""

from collections.abc import Callable
from dataclasses import dataclass
from random import Random
from types import ModuleType
from typing import Any, Final

from drivers.protocol import v1, v2
from drivers.servos import ax_mx, scs, sts, x
from drivers.servos.register import ServoModel
from drivers.servos.xl320 import XL320
from sim_backend.box import VirtualBox
from sim_backend.buses.dynamixel import VirtualDynamixelBus
from sim_backend.buses.feetech import VirtualBus
from sim_backend.line.line import ServoLine
from sim_backend.mechanics.plant import BenchPlant
from sim_backend.packets import dynamixel as dynamixel_wire
from sim_backend.packets import sts as sts_wire
from tests.mutated import raw

IDS: Final = (1, 2)


@dataclass(frozen=True, slots=True)
class Make:
    """A make of servo: the packets of its protocol, and a virtual line."""

    packets: ModuleType
    wire: ModuleType
    line: Callable[[], ServoLine[Any]]


def _first(models: dict[str, Any], bulk_read: bool | None = None) -> ServoModel:
    return next(model for model in models.values() if bulk_read is None or bool(model.bulk_read) is bulk_read)


def _of_v1(model: ServoModel) -> Make:
    return Make(v1, sts_wire, lambda: VirtualBus.of(BenchPlant(IDS), model))


def _of_v2(model: ServoModel) -> Make:
    return Make(v2, dynamixel_wire, lambda: VirtualDynamixelBus.of(BenchPlant(IDS), dict.fromkeys(IDS, model)))


def _boxed() -> ServoLine[Any]:
    """Return factory-new servos, which all have the same ID."""
    box = VirtualBox([sts.STS3215, sts.STS3215])
    box.connect(0, 1)
    return box.line


MAKES: Final = {
    "box": Make(v1, sts_wire, _boxed),
    "sts": _of_v1(sts.STS3215),
    "scs": _of_v1(_first(scs.MODELS)),
    "ax": _of_v1(_first(ax_mx.MODELS, bulk_read=False)),
    "mx": _of_v1(_first(ax_mx.MODELS, bulk_read=True)),
    "x": _of_v2(x.XL430_W250),
    "xl330": _of_v2(x.XL330_M288),
    "xl320": _of_v2(XL320),
}


def stream(make: Make, chance: Random) -> bytes:
    """Return one to four packets. Half of the streams have changed bytes."""
    found = b"".join(_packet(make, chance) for _ in range(chance.choice((1, 1, 1, 2, 4))))
    return raw.changed(found, chance)[:1000] if chance.random() < 0.5 else found


def _packet(make: Make, chance: Random) -> bytes:
    to = chance.choice((*IDS, *IDS, 0xFE, chance.randrange(256)))
    code = int(chance.choice((*make.wire.Code, chance.randrange(256))))
    parameters = chance.choice((_frame, _frame, _group, _group, _any))(make, chance)
    packet: bytes = make.packets.packet(to, code, parameters[:250])
    return packet


def _any(make: Make, chance: Random) -> bytes:
    return chance.randbytes(chance.choice((0, 1, 2, 3, 7, 20, 250)))


def _frame(make: Make, chance: Random) -> bytes:
    """Return an address and a size, followed by the data of a write."""
    return _number(make, chance) + _number(make, chance) + _any(make, chance)[: chance.choice((0, 0, 1, 4, 20))]


def _group(make: Make, chance: Random) -> bytes:
    """Return an address and a size, followed by an entry for each of several servos."""
    size = chance.choice((0, 1, 2, 4, 6, 200))
    entries = [
        bytes(
            (
                chance.choice(
                    (*IDS, chance.randrange(256)),
                ),
            )
        )
        + chance.randbytes(size)
        for _ in range(3)
    ]
    width = 1 if make.packets is v1 else 2
    return _number(make, chance) + size.to_bytes(width, "little") + b"".join(entries)


def _number(make: Make, chance: Random) -> bytes:
    """Return an address or a size in the width of the protocol: that of a register, one at an end of the range, or a
    random one."""
    width = 1 if make.packets is v1 else 2
    largest = 256**width - 1
    value = chance.choice((chance.randrange(80), chance.randrange(160), 0, largest, chance.randint(0, largest)))
    return value.to_bytes(width, "little")
