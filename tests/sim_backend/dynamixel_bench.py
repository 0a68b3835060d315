"""A virtual X series servo on a shaft, with the single-servo instructions of the official SDK over our port."""

import importlib
from math import pi
from typing import Any

from drivers.bus.sdk_adapter import SdkAdapter
from drivers.port.line import Line
from drivers.servos import x
from drivers.servos.register import Register, ServoModel
from sim_backend.buses.dynamixel import VirtualDynamixelBus
from sim_backend.buses.port import VirtualPort
from sim_backend.clock import SimulatedClock
from sim_backend.mechanics.plant import BenchPlant

# Imported by name, because the SDK has no type hints.
sdk: Any = importlib.import_module("dynamixel_sdk")
handler = sdk.Protocol2PacketHandler()


class Bench:
    """A servo on a shaft. ``run`` advances the time."""

    def __init__(self, model: ServoModel = x.XL430_W250, *, load_nm: float = 0.0, firmware: int | None = None) -> None:
        self.clock = SimulatedClock()
        self.plant = BenchPlant((1,))
        self.plant.load_nm[:] = [load_nm]
        versions = {} if firmware is None else {1: firmware}
        self.bus = VirtualDynamixelBus.of(self.plant, {1: model}, firmware=versions)
        self.port = SdkAdapter(Line(VirtualPort(self.bus, self.clock), self.clock))
        self.servo = self.bus.servo(1)

    def run(self, seconds: float) -> None:
        self.clock.sleep_until(self.clock.now() + seconds)
        self.bus.advance(self.clock.now())

    def write(self, register: Register, value: int) -> int:
        data = list(register.encode(value, "little"))
        result, error = handler.writeTxRx(self.port, 1, register.address, register.size, data)
        assert result == sdk.COMM_SUCCESS
        return int(error)

    def write_all(self, values: dict[Register, int]) -> None:
        """Write registers one after the other; the servo must accept all of them."""
        assert {register.name: self.write(register, value) for register, value in values.items()} == {
            register.name: 0 for register in values
        }

    def read(self, register: Register) -> int:
        data, result, _ = handler.readTxRx(self.port, 1, register.address, register.size)
        assert result == sdk.COMM_SUCCESS
        return register.decode(bytes(data), "little")

    def turn_by_hand(self, counts: int) -> None:
        """Turn the shaft of a servo without torque by this number of counts."""
        self.plant.place([self.plant.angles()[0] + counts * 2.0 * pi / 4096])
        self.run(0.3)
