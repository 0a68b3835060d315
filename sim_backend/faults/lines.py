"""Faults of an entire bus: its cable, its supply, its adapter, and other programs that use the bus."""

from collections.abc import Iterator
from contextlib import ExitStack, contextmanager
from pathlib import Path
from random import Random
from typing import Any, ClassVar, Literal, Self

from pydantic import field_validator, model_validator

from drivers.servos.catalog import series_of
from drivers.servos.register import ServoModel
from hal.plausible import Duration, Ohms, ServoId, Volts
from sim_backend.faults.event import Lasting, OfBus, OfServo, any_servo
from sim_backend.faults.fault_error import FaultError
from sim_backend.faults.tails import about, log_uniform
from sim_backend.faults.targets import FaultTargets, Inventory
from sim_backend.line.line import ServoLine
from sim_backend.line.power import feed, restart, watch_supply

READ, WRITE = 2, 3
"""Instruction codes, which are the same in all protocols."""


class CableCut(OfBus, Lasting):
    """The daisy-chain cable breaks after a servo. All servos after the break lose data and power, so their joints go
    limp."""

    kind: Literal["cable_cut"] = "cable_cut"
    after: ServoId | None = None
    """Last servo that is still connected; None if the cable breaks before the first servo."""

    def refuse(self, there: Inventory) -> None:
        super().refuse(there)
        if any(first == len(there.servos[bus]) for bus, first in self._cut(there).items()):
            raise FaultError(
                f"servo {self.after} is the last one on its bus, so there is no servo after it: choose another servo"
            )

    def _cut(self, there: Inventory) -> dict[str, int]:
        """Return the index of the first disconnected servo on each bus."""
        if self.after is None:
            return dict.fromkeys(there.buses(self.bus), 0)
        bus = there.bus_of(self.after, self.bus)
        return {bus: list(there.servos[bus]).index(self.after) + 1}

    @contextmanager
    def acting(self, targets: FaultTargets) -> Iterator[None]:
        with ExitStack() as cut:
            for bus, first in self._cut(targets.inventory).items():
                line = targets.lines[bus]
                for servo in line.servos[first:]:
                    cut.enter_context(_off(targets, line, servo))
            yield

    @classmethod
    def draw_parameters(cls, random: Random, there: Inventory) -> dict[str, Any]:
        return {**super().draw_parameters(random, there), **_after(random, there)}


@contextmanager
def _off(targets: FaultTargets, line: ServoLine[Any], servo: Any) -> Iterator[None]:
    def pull(pulled: bool) -> None:
        if pulled:
            line.unplug(servo)
        else:
            line.plug(servo)
            restart(servo)

    with targets.holds.hold(("plug", servo), pull, True, False):
        yield


def _after(random: Random, there: Inventory) -> dict[str, Any]:
    named = any_servo(random, {bus: dict(list(ids.items())[:-1]) or ids for bus, ids in there.servos.items()})
    return {"bus": named["bus"], "after": named["servo_id"]}


class WeakSupply(OfBus, Lasting):
    """The supply has the wrong voltage, or its leads are too thin. A servo restarts if the voltage at its controller is
    too low."""

    kind: Literal["weak_supply"] = "weak_supply"
    WEIGHT: ClassVar[int] = 2
    voltage_v: Volts | None = None
    """No-load voltage; None to leave it unchanged."""
    resistance_ohm: Ohms | None = None
    """Lead resistance; None to leave it unchanged."""

    @model_validator(mode="after")
    def _weak(self) -> Self:
        if self.voltage_v is None and self.resistance_ohm is None:
            raise ValueError("a weak supply needs voltage_v, resistance_ohm, or both")
        return self

    @contextmanager
    def acting(self, targets: FaultTargets) -> Iterator[None]:
        with ExitStack() as weak:
            for line in targets.lines_of(self.bus):
                weak.enter_context(_fed(targets, line, (self.voltage_v, self.resistance_ohm)))
            yield

    @classmethod
    def draw_parameters(cls, random: Random, there: Inventory) -> dict[str, Any]:
        parameters = super().draw_parameters(random, there)
        fed = [model for bus in there.buses(parameters["bus"]) for model in there.servos[bus].values()]
        # Half of the voltages are near the servo's range, because a servo stops if the voltage is far too low.
        voltage_v = about(random, min(model.rated_voltage_v for model in fed), random.choice((1.5, 4.0)))
        drawn = random.choice([{"voltage_v": voltage_v}, {"resistance_ohm": log_uniform(random, 0.01, 20.0)}])
        if parameters["for_s"] is not None:  # only a voltage that is wrong for more than a second is reported
            drawn["for_s"] = log_uniform(random, 0.05, 20.0)
        return {**parameters, **drawn}


@contextmanager
def _fed(targets: FaultTargets, line: ServoLine[Any], supply: tuple[float | None, float | None]) -> Iterator[None]:
    def change(what: tuple[float | None, float | None]) -> None:
        feed(line, *what)

    def watch(time_s: float) -> None:
        watch_supply(line)

    with targets.each_step(watch), targets.holds.hold(("supply", line), change, supply, (None, None)):
        yield


class Echo(OfBus, Lasting):
    """The adapter's transmit and receive wires are connected, so each instruction is echoed before the reply."""

    kind: Literal["echo"] = "echo"

    @contextmanager
    def acting(self, targets: FaultTargets) -> Iterator[None]:
        with ExitStack() as echo:
            for line in targets.lines_of(self.bus):
                echo.enter_context(_echoing(targets, line))
            yield


@contextmanager
def _echoing(targets: FaultTargets, line: ServoLine[Any]) -> Iterator[None]:
    def join(joined: bool) -> None:
        line.faults.echo = joined

    with targets.holds.hold(("echo", line), join, True, False):
        yield


class AdapterUnplugged(OfBus, Lasting):
    """The adapter is unplugged, and plugged in again under the same or another name. The servos remain powered."""

    kind: Literal["adapter_unplugged"] = "adapter_unplugged"
    back_as: str | None = None
    """Name of the adapter when it is plugged in again; None for the same name."""

    @field_validator("back_as")
    @classmethod
    def _named(cls, name: str | None) -> str | None:
        if name == "":
            raise ValueError("must not be empty: omit it to keep the name of the adapter")
        return name

    @model_validator(mode="after")
    def _comes_back(self) -> Self:
        if self.back_as is not None and self.for_s is None:
            raise ValueError("back_as needs for_s: the time after which the adapter is plugged in again")
        return self

    def refuse(self, there: Inventory) -> None:
        super().refuse(there)
        if not there.adapters:
            raise FaultError("there is no adapter to unplug: the bus is connected directly to this program")
        if not there.stack and self.back_as is not None and not _is_file_name(self.back_as):
            raise FaultError(
                "an emulator plugs its adapter in again in the same folder: set `as` to a file name, such as another, "
                f"not {self.back_as!r}"
            )

    @contextmanager
    def acting(self, targets: FaultTargets) -> Iterator[None]:
        adapters = [targets.adapters[name] for name in targets.inventory.buses(self.bus)]
        with ExitStack() as pulled:
            for adapter in adapters:

                def pull(out: str | None, adapter: Any = adapter) -> None:
                    adapter.unplug() if out == "" else adapter.plug(out)

                # If two faults have unplugged the adapter, it is plugged in again when the last of them ends.
                pulled.enter_context(targets.holds.hold(("adapter", adapter), pull, "", self.back_as))
            yield

    @classmethod
    def draw_parameters(cls, random: Random, there: Inventory) -> dict[str, Any]:
        parameters = super().draw_parameters(random, there)
        other = random.choice([None, "another"]) if parameters["for_s"] else None
        return {**parameters, "back_as": other}


def _is_file_name(name: str) -> bool:
    return Path(name).name == name and name != ".."


class ForeignPackets(OfServo, Lasting):
    """Another program uses the bus between the stack's packets. The other program reads a servo or disables its
    torque."""

    kind: Literal["foreign_packets"] = "foreign_packets"
    every_s: Duration = 0.1
    does: Literal["reads", "lets_go"] = "reads"

    @contextmanager
    def acting(self, targets: FaultTargets) -> Iterator[None]:
        place = self.place(targets)
        packet, next_s = self._packet(place.servo.model), -1.0

        def talk(time_s: float) -> None:
            nonlocal next_s
            if time_s >= next_s:
                place.line.faults.foreign.append(packet)
                next_s = time_s + self.every_s

        with targets.each_step(talk):
            yield

    def _packet(self, model: ServoModel) -> bytes:
        series = series_of(model)
        packets = series.protocol.packets
        if self.does == "reads":
            place = series.goal_position
            return bytes(packets.packet(self.servo_id, READ, packets.span(place.address, place.size)))
        switch = series.torque_enable
        return bytes(packets.packet(self.servo_id, WRITE, packets.place(switch.address) + bytes(switch.size)))

    @classmethod
    def draw_parameters(cls, random: Random, there: Inventory) -> dict[str, Any]:
        every_s, does = log_uniform(random, 0.001, 1.0), random.choice(["reads", "lets_go"])
        return {**super().draw_parameters(random, there), "every_s": every_s, "does": does}
