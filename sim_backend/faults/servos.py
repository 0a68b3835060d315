"""Faults of one servo: its data line, its power, its motor and its encoder."""

from collections.abc import Iterator
from contextlib import contextmanager
from random import Random
from typing import Annotated, Any, Final, Literal

from pydantic import Field

from drivers.servos import sts, x
from drivers.servos.register import ServoModel
from hal.plausible import Celsius, Chance, Duration
from sim_backend.faults.event import Lasting, Momentary, OfServo
from sim_backend.faults.tails import about, log_uniform
from sim_backend.faults.targets import FaultTargets, Inventory
from sim_backend.line.power import restart

BEARABLE_C: Final = 70.0
"""Maximum temperature at which a servo with factory settings drives its motor, in degrees Celsius."""
SHORT: Final = 0.5
"""Fraction of the drawn brown-outs after which the servo responds sooner than usual."""
SHORT_BOOT_S: Final = (0.002, 0.1)
"""Range of the time after which such a servo responds, in seconds: from a part of one cycle to several cycles."""
FEWEST_TURNS: Final = 0.02
"""Minimum fraction of a winding's turns that a short leaves intact. With fewer turns, the motor would short-circuit the
bus's supply, which is not modeled."""


class Silent(OfServo, Lasting):
    """The data line to one servo breaks. The servo neither receives nor replies, and it holds its last goal."""

    kind: Literal["silent"] = "silent"

    @contextmanager
    def acting(self, targets: FaultTargets) -> Iterator[None]:
        place = self.place(targets)
        mute, servo = place.line.faults.mute, place.servo

        def cut(off: bool) -> None:
            (mute.add if off else mute.discard)(servo)

        with targets.holds.hold(("silent", servo), cut, True, False):
            yield


class BrownOut(Momentary, OfServo):
    """The voltage at a servo drops briefly, and the servo restarts. The RAM contents are lost, the torque is disabled,
    and the EEPROM keeps its values."""

    kind: Literal["brown_out"] = "brown_out"
    boot_s: Duration | None = None
    """Time until the servo responds again, in seconds; None for the usual time of its series. A servo that responds
    within one cycle may receive the next goal, which enables the torque of most servos."""

    @contextmanager
    def acting(self, targets: FaultTargets) -> Iterator[None]:
        restart(self.place(targets).servo, self.boot_s)
        yield

    @classmethod
    def draw_parameters(cls, random: Random, there: Inventory) -> dict[str, Any]:
        boot_s = log_uniform(random, *SHORT_BOOT_S) if random.random() < SHORT else None
        return {**super().draw_parameters(random, there), "boot_s": boot_s}


class LoosePlug(OfServo, Lasting):
    """A servo's plug has a loose contact. The servo repeatedly loses power for a short time."""

    kind: Literal["loose_plug"] = "loose_plug"
    every_s: Duration = 1.0

    @contextmanager
    def acting(self, targets: FaultTargets) -> Iterator[None]:
        servo, next_s = self.place(targets).servo, -1.0

        def shake(time_s: float) -> None:
            nonlocal next_s
            if time_s >= next_s:
                restart(servo)
                next_s = time_s + self.every_s

        with targets.each_step(shake):
            yield

    @classmethod
    def draw_parameters(cls, random: Random, there: Inventory) -> dict[str, Any]:
        return {**super().draw_parameters(random, there), "every_s": log_uniform(random, 0.01, 5.0)}


class Hot(OfServo, Lasting):
    """The motor of a servo is at least at the given temperature, as if the servo were in a closed box. The motor cools
    down after the fault."""

    kind: Literal["hot"] = "hot"
    temperature_c: Celsius = 90.0

    @contextmanager
    def acting(self, targets: FaultTargets) -> Iterator[None]:
        firmware = self.place(targets).servo.firmware

        def heat(time_s: float = 0.0) -> None:
            firmware.temperature_c = max(self.temperature_c, firmware.temperature_c)

        heat()
        with targets.each_step(heat):
            yield

    @classmethod
    def draw_parameters(cls, random: Random, there: Inventory) -> dict[str, Any]:
        return {**super().draw_parameters(random, there), "temperature_c": about(random, BEARABLE_C, 2.5)}


class Overcurrent(OfServo, Lasting):
    """A winding is partly shorted. Only some of the turns remain, so the motor needs more current for the same
    torque."""

    kind: Literal["overcurrent"] = "overcurrent"
    turns_left: Annotated[Chance, Field(ge=FEWEST_TURNS, lt=1.0)] = 0.05

    def refuse_model(self, model: ServoModel, there: Inventory) -> None:
        if model not in sts.MODELS.values():
            raise self.cannot(model, "has no overcurrent protection")

    @contextmanager
    def acting(self, targets: FaultTargets) -> Iterator[None]:
        servo = self.place(targets).servo

        def wind(share: float) -> None:
            servo.firmware.turns_left = share

        with targets.holds.hold(("winding", servo), wind, self.turns_left, 1.0):
            yield

    @classmethod
    def draw_parameters(cls, random: Random, there: Inventory) -> dict[str, Any]:
        return {**super().draw_parameters(random, there), "turns_left": log_uniform(random, FEWEST_TURNS, 0.99)}


class DeadEncoder(OfServo, Lasting):
    """The encoder does not respond to the firmware, and the servo's status reports this failure."""

    kind: Literal["dead_encoder"] = "dead_encoder"

    def refuse_model(self, model: ServoModel, there: Inventory) -> None:
        if model not in sts.MODELS.values():
            raise self.cannot(model, "does not report the state of its encoder")

    @contextmanager
    def acting(self, targets: FaultTargets) -> Iterator[None]:
        servo = self.place(targets).servo

        def fail(fails: bool) -> None:
            servo.firmware.encoder_fails = fails

        with targets.holds.hold(("encoder_fails", servo), fail, True, False):
            yield


class HardwareError(Momentary, OfServo):
    """A Dynamixel X detects a failure of its motor encoder or its circuit, and reports the failure until the servo
    restarts."""

    kind: Literal["hardware_error"] = "hardware_error"
    error: Literal["motor_encoder", "electrical_shock"] = "electrical_shock"

    def refuse_model(self, model: ServoModel, there: Inventory) -> None:
        if model not in x.MODELS.values():
            raise self.cannot(model, "does not report such errors")

    @contextmanager
    def acting(self, targets: FaultTargets) -> Iterator[None]:
        bit = next(bit for bit, name in x.HARDWARE_ERROR_BITS.items() if name == self.error.replace("_", " "))
        self.place(targets).servo.firmware.protection.status |= 1 << bit
        yield

    @classmethod
    def draw_parameters(cls, random: Random, there: Inventory) -> dict[str, Any]:
        return {**super().draw_parameters(random, there), "error": random.choice(["motor_encoder", "electrical_shock"])}


class StuckEncoder(OfServo, Lasting):
    """The encoder always reports the same angle, because its magnet has come off."""

    kind: Literal["stuck_encoder"] = "stuck_encoder"

    @contextmanager
    def acting(self, targets: FaultTargets) -> Iterator[None]:
        servo = self.place(targets).servo

        def stick(sticks: bool) -> None:
            servo.firmware.encoder_sticks = sticks

        with targets.holds.hold(("encoder_sticks", servo), stick, True, False):
            yield
