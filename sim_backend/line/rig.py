"""Servos on a plant, including their power supplies, which are advanced together in fixed steps. The simulation is
deterministic."""

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from functools import partial
from typing import Generic, Protocol, TypeVar

import numpy as np
from numpy.typing import NDArray

from sim_backend.mechanics.gears import Gears
from sim_backend.mechanics.plant import Plant
from sim_backend.servos.generic.packet_servo import Fed
from sim_backend.servos.sts.firmware import StsFirmware
from sim_backend.servos.sts.kernel import step_all
from sim_backend.servos.sts.state import STATE, SUPPLY, Supplies


@dataclass(frozen=True, slots=True)
class Supply:
    """A power supply with leads. The resistance of the leads, multiplied by the total current of all servos on this
    supply, reduces the voltage at the servos."""

    voltage_v: float = 12.0
    resistance_ohm: float = 0.1


class Stepped(Protocol):
    """The part of a servo that a rig uses."""

    @property
    def servo_id(self) -> int: ...

    @property
    def firmware(self) -> Fed: ...

    @property
    def gears(self) -> Gears | None: ...

    def step(self, dt_s: float, angle_rad: float, velocity_rad_s: float) -> float: ...


AnyServo = TypeVar("AnyServo", bound=Stepped)


class Rig(Generic[AnyServo]):
    """Rig that advances the firmware of all servos, their supply voltages, and the plant."""

    def __init__(
        self, servos: Sequence[AnyServo], plant: Plant, supply: Supply | Sequence[Supply] | None = None
    ) -> None:
        """Create a rig.

        ``supply`` is one supply for all servos, or a sequence with one supply per servo, in which servos may share a
        supply; None selects the default supply.
        """
        if [s.servo_id for s in servos] != [c.servo_id for c in plant.couplings]:
            raise ValueError("servos and the plant's couplings must have the same IDs in the same order")
        self.servos = tuple(servos)
        self.plant = plant
        self.timestep_s = plant.timestep_s
        plant.fit([servo.gears for servo in servos])
        self._steps = [servo.step for servo in servos]
        self._firmware = [servo.firmware for servo in servos]
        self.supply = supply or Supply()
        each = [self.supply] * len(servos) if isinstance(self.supply, Supply) else self.supply
        # Two supplies with the same voltage are still separate supplies.
        supplies = list({id(supply): supply for supply in each}.values())
        self._loads = [
            (supply, [servo for servo, own in zip(self._firmware, each, strict=True) if own is supply])
            for supply in supplies
        ]
        self._built = self._loads
        self._shared: Supplies | None = None
        self.tables: NDArray[np.uint8] | None = None
        """Live control tables, one row for each servo, if all are STS servos. Only the servos write to the control
        tables."""
        self._step_servos = self._compiled() or self._one_by_one
        for firmware, angle in zip(self._firmware, plant.angles(), strict=True):
            firmware.observe(angle)

    def step(self) -> None:
        """Advance everything by one timestep."""
        self._step_servos()
        self.plant.advance()

    def feed(self, voltage_v: float | None = None, resistance_ohm: float | None = None) -> None:
        """Change the voltage of all supplies and the resistance of their leads. None restores the original value."""
        self._loads = [
            (
                Supply(
                    supply.voltage_v if voltage_v is None else voltage_v,
                    supply.resistance_ohm if resistance_ohm is None else resistance_ohm,
                ),
                servos,
            )
            for supply, servos in self._built
        ]
        if self._shared is not None:
            self._shared["voltage_v"] = [supply.voltage_v for supply, _ in self._loads]
            self._shared["resistance_ohm"] = [supply.resistance_ohm for supply, _ in self._loads]

    def supply_of(self, servo: AnyServo) -> Supply:
        """Return the supply that currently feeds the servo."""
        return next(supply for supply, loads in self._loads if servo.firmware in loads)

    def _compiled(self) -> Callable[[], None] | None:
        """Return a compiled function that advances all servos by one timestep, or None if not all of them are STS
        servos."""
        firmware = [firmware for firmware in self._firmware if isinstance(firmware, StsFirmware)]
        if len(firmware) < len(self._firmware):
            return None
        states = np.zeros(len(firmware), STATE)
        for i, one in enumerate(firmware):
            one.work_on(states[i : i + 1])
            states["supply"][i] = next(k for k, (_, loads) in enumerate(self._loads) if one in loads)
        self.tables = states["table"]
        self._shared = shared = np.array(
            [(supply.voltage_v, supply.resistance_ohm, 0.0) for supply, _ in self._loads], SUPPLY
        )
        joints, shafts = self.plant.joints, self.plant.shafts
        position, velocity, effort = joints.position, joints.velocity, joints.effort
        return partial(step_all, states, shared, shafts, position, velocity, effort, self.timestep_s)

    def _one_by_one(self) -> None:
        """Advance servos of any type by one timestep."""
        dt_s, plant = self.timestep_s, self.plant
        for supply, loads in self._loads:
            total_a = 0.0
            for servo in loads:
                total_a += servo.supply_current_a
            voltage_v = max(0.0, supply.voltage_v - total_a * supply.resistance_ohm)
            for servo in loads:
                servo.voltage_v = voltage_v
        state = zip(self._steps, plant.angles(), plant.velocities(), strict=True)
        plant.push([step(dt_s, angle, velocity) for step, angle, velocity in state])
