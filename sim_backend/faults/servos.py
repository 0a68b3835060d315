"""Faults of one servo: its data line, its power, its motor, its encoder, its replies."""

from collections.abc import Iterator
from contextlib import contextmanager
from random import Random
from typing import Annotated, Any, Literal

from pydantic import Field

from drivers.servos import sts
from drivers.servos.register import ServoModel
from hal.plausible import Celsius, Chance, Counts, Number
from sim_backend.faults.event import Lasting, Momentary, OfServo
from sim_backend.faults.targets import Inventory, Targets
from sim_backend.mechanics.power import restart


class Silent(OfServo, Lasting):
    """The data line to one servo breaks: it neither hears nor answers, and holds what it was told last."""

    kind: Literal["silent"] = "silent"

    @contextmanager
    def acting(self, targets: Targets) -> Iterator[None]:
        place = self.place(targets)
        mute, servo = place.line.faults.mute, place.servo

        def cut(off: bool) -> None:
            (mute.add if off else mute.discard)(servo)

        with targets.holds.hold(("silent", servo), cut, True, False):
            yield


class BrownOut(Momentary, OfServo):
    """One servo's power dips and it starts anew: RAM is gone, the motor free, the EEPROM as it was."""

    kind: Literal["brown_out"] = "brown_out"

    @contextmanager
    def acting(self, targets: Targets) -> Iterator[None]:
        restart(self.place(targets).servo)
        yield


class Hot(OfServo, Lasting):
    """A servo's motor is kept at least at this temperature, as in a closed box; afterwards it cools down by itself."""

    kind: Literal["hot"] = "hot"
    temperature_c: Celsius = 90.0

    @contextmanager
    def acting(self, targets: Targets) -> Iterator[None]:
        firmware = self.place(targets).servo.firmware

        def heat(time_s: float = 0.0) -> None:
            firmware.temperature_c = max(self.temperature_c, firmware.temperature_c)

        heat()
        with targets.each_step(heat):
            yield

    @classmethod
    def draw_parameters(cls, random: Random, there: Inventory) -> dict[str, Any]:
        return {**super().draw_parameters(random, there), "temperature_c": round(random.uniform(50.0, 110.0), 1)}


class Overcurrent(OfServo, Lasting):
    """A winding is shorted: of its turns only a share is left, so the same torque takes as much more current."""

    kind: Literal["overcurrent"] = "overcurrent"
    turns_left: Annotated[Chance, Field(lt=1.0)] = 0.05

    def refuse_model(self, model: ServoModel, there: Inventory) -> None:
        if model not in sts.MODELS.values():
            raise self.cannot(model, "has no protection against too much current")

    @contextmanager
    def acting(self, targets: Targets) -> Iterator[None]:
        servo = self.place(targets).servo

        def wind(share: float) -> None:
            servo.firmware.turns_left = share

        with targets.holds.hold(("winding", servo), wind, self.turns_left, 1.0):
            yield

    @classmethod
    def draw_parameters(cls, random: Random, there: Inventory) -> dict[str, Any]:
        return {**super().draw_parameters(random, there), "turns_left": round(random.uniform(0.02, 0.5), 3)}


class DeadEncoder(OfServo, Lasting):
    """The encoder does not answer the firmware any more, and that says so in its status."""

    kind: Literal["dead_encoder"] = "dead_encoder"

    def refuse_model(self, model: ServoModel, there: Inventory) -> None:
        if model not in sts.MODELS.values():
            raise self.cannot(model, "says nothing of its encoder")

    @contextmanager
    def acting(self, targets: Targets) -> Iterator[None]:
        servo = self.place(targets).servo

        def fail(fails: bool) -> None:
            servo.firmware.encoder_fails = fails

        with targets.holds.hold(("encoder_fails", servo), fail, True, False):
            yield


class StuckEncoder(OfServo, Lasting):
    """The encoder reports the same angle from then on, whatever the shaft does: its magnet has come off."""

    kind: Literal["stuck_encoder"] = "stuck_encoder"

    @contextmanager
    def acting(self, targets: Targets) -> Iterator[None]:
        servo = self.place(targets).servo

        def stick(sticks: bool) -> None:
            servo.firmware.encoder_sticks = sticks

        with targets.holds.hold(("encoder_sticks", servo), stick, True, False):
            yield


class FalsePosition(OfServo, Lasting):
    """A servo reports a false position in a reply whose checksum is right; its own control loop has the true one."""

    kind: Literal["false_position"] = "false_position"
    counts: Counts = 1000
    """Added to the true position."""
    every: Annotated[Number, Field(ge=1)] = 1
    """Of the replies that report the position, every n-th is false, the first one included."""
    replies: Annotated[Number, Field(ge=1)] | None = None
    """Number of false replies. None: as many as there are until the fault ends."""

    @contextmanager
    def acting(self, targets: Targets) -> Iterator[None]:
        servo = self.place(targets).servo
        asked = 0

        def falsify(address: int, size: int, data: bytes) -> bytes:
            nonlocal asked
            false = _with_position(servo, self.counts, address, size)
            if false == data:  # the position is not in this reply
                return data
            number, due = divmod(asked, self.every)
            asked += 1
            return data if due or (self.replies is not None and number >= self.replies) else false

        servo.on_read.append(falsify)
        try:
            yield
        finally:
            servo.on_read.remove(falsify)

    @classmethod
    def draw_parameters(cls, random: Random, there: Inventory) -> dict[str, Any]:
        return {
            **super().draw_parameters(random, there),
            "counts": random.choice((-1, 1)) * random.choice((random.randint(20, 400), random.randint(400, 4096))),
            "every": random.choice((1, 1, 2, 3, random.randint(4, 30))),
            "replies": random.choice((1, 1, 2, None)),
        }


def _with_position(servo: Any, counts: int, address: int, size: int) -> bytes:
    """A part of the servo's table, if its shaft were ``counts`` further; the other way where that is no position."""
    memory, register = servo.memory, servo.PRESENT_POSITION
    true = memory.get(register)
    further = true + counts
    memory.put(register, further if register.smallest <= further <= register.largest else true - counts)
    data: bytes = memory.read(address, size)
    memory.put(register, true)
    return data
