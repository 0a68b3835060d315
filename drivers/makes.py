"""Which bus drives which servos."""

from collections.abc import Mapping

from drivers.bus import ServoBus
from drivers.clock import Clock
from drivers.dynamixel.bus import DynamixelBus
from drivers.feetech.bus import FeetechBus
from drivers.feetech.sts import MODELS as STS_MODELS
from drivers.port import Port
from drivers.registers import ServoModel


def bus_for(
    models: Mapping[int, ServoModel], port: Port, clock: Clock, position_p: Mapping[int, int] | None = None
) -> ServoBus:
    """The bus that drives these servos, by ID. ``position_p``: P gains that Dynamixels are given with the torque."""
    if all(model in STS_MODELS.values() for model in models.values()):
        return FeetechBus(port, clock)
    return DynamixelBus(port, clock, position_p)
