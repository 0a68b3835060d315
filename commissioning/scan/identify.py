"""Identify the make, series and model of a servo from the first registers of its control table."""

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
"""First registers of both protocol 1.0 makes: model number, firmware, ID and baud rate, in a different order."""
SCS_MAJOR: Final = 5
"""First byte of the model number of an SCS servo, whose words are big-endian. In the STS series this byte is 9."""

Result = TypeVar("Result")


@dataclass(frozen=True, slots=True)
class Identity:
    """Identity of a servo. ``model`` is None if the model number is unknown."""

    series: Series
    model: ServoModel | None
    number: int
    firmware: str

    @property
    def stand_in(self) -> ServoModel:
        """Model used to encode the servo's packets. If the servo's own model is unknown, this is the first model of its
        series, whose control table may differ."""
        return self.model or self.series.models[0]


def retry_often(question: Callable[[], Result]) -> Result:
    """Retry a request more often than ``retry`` does, for a bus of unknown quality."""
    return retry(partial(retry, question))


def identify(port: Port, clock: Clock, packets: ModuleType, servo_id: int) -> Identity:
    """Read the identity of a servo. Raises ServoError if the servo does not send valid replies."""
    if packets is v1:
        bus = Bus(port, clock)
        head = retry_often(partial(bus.read, servo_id, HEAD))
        return identity_of(head.to_bytes(HEAD.size, "little"), servo_id)
    bus = Bus(port, clock, {servo_id: X.models[0]})
    number = retry_often(partial(bus.read, servo_id, x.model_number))
    series, version = (XL, xl320.firmware_version) if number == xl320.XL320.number else (X, x.firmware_version)
    return Identity(series, _model(series, number), number, str(retry_often(partial(bus.read, servo_id, version))))


def identity_of(head: bytes, servo_id: int) -> Identity:
    """Return the identity of a protocol 1.0 servo, derived from its first registers.

    The position of the ID in the table indicates the make. If both makes are possible, the make with a known model
    number is chosen.
    """
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
    """Return the first model with this number. Variants of a servo with different gears share the same model number."""
    assert series in SERIES
    return next((model for model in series.models if model.number == number), None)
