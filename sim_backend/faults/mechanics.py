"""Faults of gears and joints."""

from collections.abc import Iterator
from contextlib import contextmanager
from math import pi
from random import Random
from typing import Any, Final, Literal

from pydantic import field_validator

from drivers.servos.register import ServoModel
from hal.plausible import RANGES, Counts, Torque
from sim_backend.faults.event import Lasting, Momentary, OfServo, model_of
from sim_backend.faults.fault_error import FaultError
from sim_backend.faults.tails import about, either_way, log_uniform
from sim_backend.faults.targets import FaultTargets, Inventory, Mechanics

JAMMED: Final = "jammed"
"""Fault type for jammed gears."""


class Jammed(OfServo, Lasting):
    """The gears of a servo jam. No force can move the servo's joint."""

    kind: Literal["jammed"] = "jammed"

    def refuse_model(self, model: ServoModel, there: Inventory) -> None:
        _require_world(there, self.kind)

    @contextmanager
    def acting(self, targets: FaultTargets) -> Iterator[None]:
        world, joint = _world(targets), self.place(targets).joint

        def jam(jammed: bool) -> None:
            (world.jam if jammed else world.free)(joint)

        with targets.holds.hold((JAMMED, joint), jam, True, False):
            yield


class Overload(OfServo, Lasting):
    """An external torque of at most 100 N m acts on a servo's shaft.

    By default, this torque exceeds the servo's own torque, which triggers the servo's protection.
    """

    kind: Literal["overload"] = "overload"
    torque_nm: Torque = 4.0
    """Torque on the shaft. Positive values pull toward larger joint positions."""

    def refuse_model(self, model: ServoModel, there: Inventory) -> None:
        _require_world(there, self.kind)

    @contextmanager
    def acting(self, targets: FaultTargets) -> Iterator[None]:
        world, place = _world(targets), self.place(targets)
        effort = self.torque_nm / abs(place.ratio)
        world.load(place.joint, effort)
        try:
            yield
        finally:
            world.load(place.joint, -effort)

    @classmethod
    def draw_parameters(cls, random: Random, there: Inventory) -> dict[str, Any]:
        parameters = super().draw_parameters(random, there)
        stall_nm = model_of(parameters, there).stall_torque_nm
        torque_nm = min(about(random, stall_nm, 10.0), RANGES["torque"].highest)
        return {**parameters, "torque_nm": either_way(random, torque_nm)}


class SlippedHorn(Momentary, OfServo):
    """The horn slips on the shaft. From then on, the encoder reading is ``counts`` higher at the same joint
    position."""

    kind: Literal["slipped_horn"] = "slipped_horn"
    counts: Counts

    @field_validator("counts")
    @classmethod
    def _slips(cls, counts: int) -> int:
        if counts == 0:
            raise ValueError("a slip of 0 counts has no effect: use a positive or negative number of counts")
        return counts

    @contextmanager
    def acting(self, targets: FaultTargets) -> Iterator[None]:
        place = self.place(targets)
        place.line.rig.plant.slip(place.number, self.counts * 2.0 * pi / place.servo.model.counts_per_turn)
        yield

    @classmethod
    def draw_parameters(cls, random: Random, there: Inventory) -> dict[str, Any]:
        counts = either_way(random, round(log_uniform(random, 1.0, 2048.0)))
        return {**super().draw_parameters(random, there), "counts": counts}


def _require_world(there: Inventory, kind: str) -> None:
    if not there.world:
        raise FaultError(f"there is no simulated arm here, only servos on a bus: no joint can have {kind!r}")


def _world(targets: FaultTargets) -> Mechanics:
    assert targets.world is not None, "``refuse`` has checked this"
    return targets.world
