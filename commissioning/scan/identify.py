"""What a servo is that answers pings: its make, series and model, from the head of its table."""

from collections.abc import Callable
from dataclasses import dataclass
from functools import partial
from types import ModuleType
from typing import Final, TypeVar

from drivers.bus.bus import Bus
from drivers.bus.retry import retry
from drivers.clock import Clock
from drivers.port import Port
from drivers.protocol import v1
from drivers.servos import ax_mx as dynamixel1
from drivers.servos import scs, sts, x, xl320
from drivers.servos.catalog import SERIES
from drivers.servos.dynamixel import XL, X
from drivers.servos.dynamixel1 import AX_MX
from drivers.servos.feetech import SCS, STS
from drivers.servos.register import Access, Register, ServoModel
from drivers.servos.series import Series

HEAD: Final = Register("head of the table", 0, 7, Access.READ)
"""Both makes of protocol 1.0 have their number, firmware, ID and baud rate in it, each elsewhere."""
SCS_MAJOR: Final = 5
"""First byte of the number of a Feetech servo with its words turned round; 9 are those of the STS series."""

Result = TypeVar("Result")


@dataclass(frozen=True, slots=True)
class Identity:
    """``model`` is None for a number that no table here has; ``stand_in`` is then one of its series."""

    series: Series
    model: ServoModel | None
    number: int
    firmware: str

    @property
    def stand_in(self) -> ServoModel:
        """The model whose table it is read by."""
        return self.model or self.series.models[0]


def surely(question: Callable[[], Result]) -> Result:
    """``retry`` for a line of which one does not know how bad it is."""
    return retry(partial(retry, question))


def identify(port: Port, clock: Clock, packets: ModuleType, servo_id: int) -> Identity:
    """Read what it is. Raises ServoError where it does not answer in one piece."""
    if packets is v1:
        bus = Bus(port, clock)
        head = surely(partial(bus.read, servo_id, HEAD))
        return identity_of(head.to_bytes(HEAD.size, "little"), servo_id)
    bus = Bus(port, clock, {servo_id: X.models[0]})
    number = surely(partial(bus.read, servo_id, x.model_number))
    series, version = (XL, xl320.firmware_version) if number == xl320.XL320.number else (X, x.firmware_version)
    return Identity(series, _model(series, number), number, str(surely(partial(bus.read, servo_id, version))))


def identity_of(head: bytes, servo_id: int) -> Identity:
    """Of a servo of protocol 1.0 by its first bytes: where its ID stands tells the make, a known number decides."""
    candidates = [one for one in (_feetech(head), _dynamixel(head)) if _says_id(one.series, head, servo_id)]
    known = [one for one in candidates if one.model]
    return next(iter(known or candidates), _feetech(head))


def _says_id(series: Series, head: bytes, servo_id: int) -> bool:
    return head[series.servo_id.address] == servo_id


def _feetech(head: bytes) -> Identity:
    at = sts.model_number.address
    series = SCS if head[at] == SCS_MAJOR else STS
    number = int.from_bytes(head[at : at + 2], series.protocol.byte_order)
    firmware = f"{head[scs.firmware_major.address]}.{head[scs.firmware_minor.address]}"
    return Identity(series, _model(series, number), number, firmware)


def _dynamixel(head: bytes) -> Identity:
    number = int.from_bytes(head[:2], "little")
    return Identity(AX_MX, _model(AX_MX, number), number, str(head[dynamixel1.firmware_version.address]))


def _model(series: Series, number: int) -> ServoModel | None:
    """The first that says so: variants of one servo with other gears have one number."""
    assert series in SERIES
    return next((model for model in series.models if model.number == number), None)
