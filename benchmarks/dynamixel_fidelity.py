"""Compare the virtual Dynamixels with known facts and values: ``python -m benchmarks.dynamixel_fidelity``.

The program prints how many facts about ranges, errors, modes, profiles and the bus match (``dynamixel_facts``), and
lists the facts that do not.

The values of servos whose motors were identified are rows of ``python -m benchmarks.fidelity``. The expected values
come from ROBOTIS data sheets ("data sheet"), or follow from BAM's oscilloscope measurements, motor parameters and
friction models ("law").
"""

from collections.abc import Iterator
from math import pi
from typing import Any

from rich.console import Console
from rich.table import Table

from benchmarks.facts.dynamixel_facts import facts
from benchmarks.facts.figures import Figure
from drivers.bus.bus import Bus
from drivers.servos import ax_mx, x, xl320
from drivers.servos.ax_mx import MX_64, MX_106
from drivers.servos.register import Register, ServoModel
from sim_backend.buses.dynamixel import VirtualDynamixelBus
from sim_backend.buses.feetech import VirtualBus
from sim_backend.buses.port import VirtualPort
from sim_backend.clock import SimulatedClock
from sim_backend.line.line import ServoLine
from sim_backend.line.rig import Supply
from sim_backend.mechanics.plant import BenchPlant
from sim_backend.servos.dynamixel.motors import IDENTIFIED

RPM = 2.0 * pi / 60.0
X330, XL = x.XL330_M288, xl320.XL320
HELD_BY_COUNTS = 60
PULLS_NM = (0.1, 0.2)
FULL_DRIVE_RAD = 2.5
"""Position error at which every model applies full drive, in rad."""
XL330_PER_RAD = 4096 / (2.0 * pi) / (256 * 885) * 400
"""Fraction of full drive per rad of position error, at the factory P gain."""


class DynamixelBench:
    """Servo on a shaft, with torque enabled at its present position."""

    def __init__(self, model: ServoModel, load_nm: float = 0.0) -> None:
        self.plant, self.clock = BenchPlant([1]), SimulatedClock(0.0)
        self.plant.load_nm[:] = [load_nm]
        # Model that provides the servo's control table
        self.driven = ax_mx.MX_28 if isinstance(model, ax_mx.AxMxModel) else model
        self.line = _line(self.plant, model)
        self.bus = Bus(VirtualPort(self.line, self.clock), self.clock, {1: self.driven})
        self.table: Any = ax_mx if isinstance(model, ax_mx.AxMxModel) else xl320 if model == XL else x

    def write(self, register: Register, value: int) -> None:
        self.bus.write(1, register, value)

    def read(self, register: Register) -> int:
        return self.bus.read(1, register)

    def go(self, counts: int) -> None:
        """Enable torque and move this distance at full speed."""
        table, start = self.table, self.read(self.table.present_position)
        self.write(table.torque_enable, 1)
        self.write(table.goal_position, start + counts)

    def start_below(self, distance_rad: float) -> float:
        """Set the goal to the present position, move the shaft this far below it, and return the new angle."""
        self.go(0)
        begin_rad = self.plant.angles()[0] - distance_rad
        self.plant.place([begin_rad])
        return begin_rad

    def wait(self, seconds: float, held: bool = False) -> None:
        """Advance the time. If ``held`` is true, the shaft keeps its angle."""
        angle = self.plant.angles()
        for _ in range(round(seconds * 1000)):
            if held:
                self.plant.place(angle)
            self.clock.sleep_until(self.clock.now() + 0.001)
            self.line.advance(self.clock.now())


def _line(plant: BenchPlant, model: ServoModel) -> ServoLine[Any]:
    supply = Supply(model.rated_voltage_v, 0.0)
    if isinstance(model, ax_mx.AxMxModel):
        return VirtualBus.of(plant, model, supply=supply, paced=False)
    return VirtualDynamixelBus.of(plant, {1: model}, supply=supply, paced=False)


def drives() -> Iterator[Figure]:
    """Yield the drive at a given position error, which reveals the P gain."""
    cases: tuple[tuple[ServoModel, Register, float, float, str], ...] = (
        (X330, x.present_pwm, 885.0, XL330_PER_RAD, "law"),
        (x.XL430_W250, x.present_pwm, 885.0, 640 / 128 / 885 * 4096 / (2.0 * pi), "e-manual"),
        (XL, xl320.present_load, 1023.0, 0.05048 * 32, "law"),
        (MX_64, ax_mx.present_load, 1023.0, 0.158 * 32, "law"),
    )
    for model, shown, full, expected, source in cases:
        bench = DynamixelBench(model)
        bench.go(HELD_BY_COUNTS)
        bench.wait(0.2, held=True)
        error_rad = HELD_BY_COUNTS * 2.0 * pi / model.counts_per_turn
        measured = abs(bench.read(shown)) / full / error_rad
        yield Figure(f"{model.name}: drive per position error, factory P", "1/rad", measured, expected, source)


def speeds() -> Iterator[Figure]:
    """Yield the speeds at full drive without load."""
    why = "with each of BAM's friction laws, the XL-320 is slower than in its data sheet"
    for model in (X330, MX_64, MX_106, XL):
        bench = DynamixelBench(model)
        bench.start_below(FULL_DRIVE_RAD)
        fastest = 0.0
        for _ in range(50):
            bench.wait(0.01)
            fastest = max(fastest, abs(bench.plant.velocities()[0]))
        reason = why if model == XL else ""
        expected = model.no_load_speed_rad_s / RPM
        yield Figure(f"{model.name}: speed without load", "rpm", fastest / RPM, expected, "data sheet", reason)


def lifts(model: ServoModel, load_nm: float) -> bool:
    """Return whether the servo lifts this load at full drive."""
    bench = DynamixelBench(model, -load_nm)
    before = bench.start_below(FULL_DRIVE_RAD)
    bench.wait(0.15)
    return bench.plant.angles()[0] > before


def stall_nm(model: ServoModel) -> float:
    """Return the largest load that the servo lifts at full drive, to within 1/100 of the data sheet's stall torque."""
    lowest, highest = 0.0, 2.0 * model.stall_torque_nm
    while highest - lowest > 0.01 * model.stall_torque_nm:
        middle = (lowest + highest) / 2.0
        lowest, highest = (middle, highest) if lifts(model, middle) else (lowest, middle)
    return lowest


def stalls() -> Iterator[Figure]:
    """Yield the stall torques."""
    why = "load-dependent friction was identified on a pendulum far below stall, and extrapolated to stall"
    for model in (X330, MX_106, MX_64, XL):
        reason = "" if model == X330 else why
        measured = stall_nm(model)
        yield Figure(f"{model.name}: torque at stall", "N m", measured, model.stall_torque_nm, "data sheet", reason)


def sag_counts(load_nm: float, from_counts: int) -> int:
    """Return the distance of an XL330 from its goal under a load, after the servo has approached the goal from this
    side."""
    bench = DynamixelBench(X330, -load_nm)
    goal = bench.read(x.present_position)
    bench.start_below(-from_counts * 2.0 * pi / 4096)
    bench.wait(2.0)
    return goal - bench.read(x.present_position)


def sags() -> Iterator[Figure]:
    """Yield the stiffness of an XL330 under a load.

    Gear friction increases the stiffness when the servo lowers a load, and reduces it when the servo lifts a load.
    """
    motor = IDENTIFIED[X330.name]
    assert motor.gears is not None
    share = motor.gears.load_share + motor.gears.sticking_share
    stiffness = motor.torque_constant_nm_a * X330.rated_voltage_v / motor.resistance_ohm * XL330_PER_RAD
    lifted, lowered = (stiffness * (1 - share) / (1 + share), stiffness * (1 + share) / (1 - share))
    for name, start, expected in (("lifting", -1500, lifted), ("lowering", 300, lowered)):
        small, large = (sag_counts(load_nm, start) for load_nm in PULLS_NM)
        measured = (PULLS_NM[1] - PULLS_NM[0]) / ((large - small) * 2.0 * pi / 4096)
        yield Figure(f"{X330.name}: stiffness, {name} a load", "N m/rad", measured, expected, "law")


def dynamixels() -> Iterator[Figure]:
    """Yield all measured values."""
    for part in (drives, speeds, stalls, sags):
        yield from part()


def main() -> None:
    """Print how many facts match, and list the facts that do not. Exit with status 1 if a fact does not match."""
    found = facts()
    table = Table("", "agree", title="virtual Dynamixels compared with the facts")
    for group in dict.fromkeys(fact.group for fact in found):
        own = [fact.agrees for fact in found if fact.group == group]
        table.add_row(group, f"{sum(own)} of {len(own)}")
    table.add_row("all", f"{sum(fact.agrees for fact in found)} of {len(found)}")
    console = Console(width=100)
    console.print(table)
    wrong = [fact for fact in found if not fact.agrees]
    for fact in wrong:
        line = f"{fact.group}: {fact.name}: {fact.measured} instead of {fact.expected} ({fact.source})"
        console.print(line, soft_wrap=True)
    raise SystemExit(1 if wrong else 0)


if __name__ == "__main__":
    main()
