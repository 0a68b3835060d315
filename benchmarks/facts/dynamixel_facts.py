"""Facts about Dynamixels, and the behavior of virtual Dynamixels: ranges, errors, modes, positions, profiles and the
bus.

Sources: "E" is ROBOTIS's e-manual, and "I" is a reply from ROBOTIS in a DynamixelSDK issue.
"""

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from math import pi
from typing import Final

from drivers.protocol.v2 import packet, span
from drivers.servos import x
from drivers.servos.register import Register
from sim_backend.buses.dynamixel import VirtualDynamixelBus
from sim_backend.clock import SimulatedClock
from sim_backend.mechanics.plant import BenchPlant
from sim_backend.packets.dynamixel import BROADCAST, Code
from sim_backend.servos.dynamixel.modes import CURRENT, CURRENT_POSITION, PWM, VELOCITY
from sim_backend.servos.dynamixel.servo import VirtualXServo

DATA_RANGE, DATA_LIMIT, FAIL = 4, 6, 1
TURN: Final = 4096
TOLERANCE: Final = 0.03


@dataclass(frozen=True, slots=True)
class Fact:
    """One fact, together with the behavior of a virtual servo."""

    group: str
    name: str
    expected: object
    measured: object
    source: str = "E"

    @property
    def agrees(self) -> bool:
        """Whether the virtual servo behaves as the fact states. Floating-point numbers may differ slightly."""
        if isinstance(self.expected, float) and isinstance(self.measured, float):
            return abs(self.measured - self.expected) <= TOLERANCE * abs(self.expected)
        return self.measured == self.expected


class FactBench:
    """Servos on shafts. Writes are applied directly to the control tables, as if they had arrived in packets."""

    def __init__(self, *models: x.XModel, firmware: int | None = None) -> None:
        self.clock = SimulatedClock()
        ids = tuple(range(1, len(models) + 1))
        self.plant = BenchPlant(ids)
        self.line = VirtualDynamixelBus.of(
            self.plant,
            dict(zip(ids, models, strict=True)),
            firmware={} if firmware is None else dict.fromkeys(ids, firmware),
        )
        self.line.advance(self.clock.now())
        servo = self.line.servos[0]
        assert isinstance(servo, VirtualXServo)
        self.servo = servo

    def wait(self, seconds: float) -> None:
        """Advance the simulated time."""
        self.clock.sleep_until(self.clock.now() + seconds)
        self.line.advance(self.clock.now())

    def write(self, register: Register, value: int) -> int:
        """Write a register. Return the error number."""
        return self.servo.write(register.address, register.encode(value, "little"))

    def write_all(self, values: dict[Register, int]) -> list[int]:
        """Write several registers one after another. Return the error numbers."""
        return [self.write(register, value) for register, value in values.items()]

    def read(self, register: Register) -> int:
        """Read a register."""
        self.servo.firmware.publish()
        return self.servo.memory.get(register)

    def turn(self, counts: int) -> None:
        """Turn the limp shaft by hand."""
        self.plant.place([self.plant.angles()[0] + counts * 2.0 * pi / TURN])
        self.wait(0.3)

    def send(self, code: int, parameters: bytes, servo_id: int = BROADCAST) -> list[tuple[int, int]]:
        """Send an instruction. Return the ID and the error of each separate reply."""
        replies = self.line.receive(packet(servo_id, code, parameters), self.clock.now())
        self.wait(0.05)
        return [(reply.data[4], reply.data[8]) for reply in replies]


_RANGES: Final[Sequence[tuple[x.XModel, Register, int]]] = (
    *((x.XL430_W250, register, value) for register, value in (
        (x.return_delay, 255), (x.drive_mode, 255), (x.operating_mode, 0), (x.operating_mode, 77),
        (x.protocol_type, 9), (x.homing_offset, 1_044_480), (x.homing_offset, -1_044_480),
        (x.moving_threshold, 5000), (x.temperature_limit, 200), (x.max_voltage_limit, 500), (x.min_voltage_limit, 0),
        (x.velocity_limit, 70_000), (x.max_position_limit, 9000), (x.min_position_limit, 5000),
        (x.velocity_p_gain, 30_000), (x.bus_watchdog, 200), (x.led, 5),
    )),
    (x.XL330_M288, x.baud_rate, 7),
    (x.XL330_M288, x.current_limit, 1800),
)  # fmt: skip
"""Values that a servo rejects with error 4."""


def errors() -> Iterator[Fact]:
    """Yield facts about values outside a range, and goals beyond a limit."""
    for model, register, value in _RANGES:
        yield Fact(
            "errors", f"{model.name}: {register.name} {value}", DATA_RANGE, FactBench(model).write(register, value)
        )
    bench = FactBench(x.XL430_W250)
    bench.write(x.operating_mode, x.EXTENDED_POSITION_MODE)
    yield Fact("errors", "goal 1048576 in extended position mode", DATA_RANGE, bench.write(x.goal_position, 1_048_576))
    bench = FactBench(x.XM430_W350)
    bench.write_all({x.velocity_limit: 100, x.current_limit: 500, x.max_position_limit: 3000})
    for register, value in ((x.goal_velocity, 101), (x.goal_current, 501), (x.goal_position, 3001)):
        yield Fact("errors", f"{register.name} beyond its limit", DATA_LIMIT, bench.write(register, value))


def modes() -> Iterator[Fact]:
    """Yield facts about each model's modes, the motions in these modes, and the values that a mode change resets."""
    for model in x.MODELS.values():
        wanted = [1, 3, 4, 16] if model.current_unit_a is None else [0, 1, 3, 4, 5, 16]
        accepted = [mode for mode in range(20) if FactBench(model).write(x.operating_mode, mode) == 0]
        yield Fact("modes", f"{model.name}: modes", wanted, accepted)
    moves: tuple[tuple[int, Register, int, Register], ...] = (
        (VELOCITY, x.goal_velocity, 60, x.present_velocity),
        (PWM, x.goal_pwm, 300, x.present_pwm),
        (x.EXTENDED_POSITION_MODE, x.goal_position, 6000, x.present_position),
        (CURRENT_POSITION, x.goal_position, 6000, x.present_position),
    )
    for mode, goal, value, shown in moves:
        bench = FactBench(x.XL330_M288)
        bench.write_all({x.operating_mode: mode, x.torque_enable: 1, goal: value})
        bench.wait(3.0)
        yield Fact("modes", f"mode {mode}: {shown.name}", float(value), float(bench.read(shown)))
    bench = FactBench(x.XL330_M288)
    bench.write_all({x.operating_mode: CURRENT, x.torque_enable: 1, x.goal_current: 150})
    bench.wait(0.02)
    yield Fact("modes", "mode 0: present_current", 150.0, float(bench.read(x.present_current)))
    bench = FactBench(x.XM430_W350)
    reset = (
        x.position_p_gain,
        x.position_i_gain,
        x.feedforward_1st_gain,
        x.profile_velocity,
        x.goal_pwm,
        x.goal_current,
    )
    before = [bench.read(register) for register in reset]
    bench.write_all({**dict.fromkeys(reset, 7), x.operating_mode: CURRENT_POSITION})
    yield Fact(
        "modes",
        "a change of the mode resets gains, profile and limits",
        before,
        [bench.read(register) for register in reset],
    )


def positions() -> Iterator[Fact]:
    """Yield facts about turns, homing offsets and reverse mode."""
    bench = FactBench(x.XL430_W250)
    bench.turn(2 * TURN + 300)
    yield Fact("positions", "turns of a limp servo after two turns by hand", 2, bench.read(x.present_position) // TURN)
    bench.write(x.torque_enable, 1)
    yield Fact("positions", "  turns after torque is enabled in mode 3", 0, bench.read(x.present_position) // TURN)
    bench = FactBench(x.XL430_W250)
    bench.write(x.operating_mode, x.EXTENDED_POSITION_MODE)
    bench.turn(2 * TURN)
    bench.servo.power_cycle()
    yield Fact("positions", "mode 4: turns after a restart", 0, bench.read(x.present_position) // TURN)
    for offset, added in ((1024, 1024), (1025, 0), (-1025, 0)):
        bench = FactBench(x.XL430_W250)
        before = bench.read(x.present_position)
        bench.write(x.homing_offset, offset)
        yield Fact(
            "positions",
            f"mode 3: counts added by homing offset {offset}",
            added,
            bench.read(x.present_position) - before,
        )
    bench = FactBench(x.XL430_W250)
    bench.write(x.drive_mode, x.REVERSE)
    before = bench.read(x.present_position)
    bench.write(x.homing_offset, 200)
    yield Fact("positions", "reverse mode: counts added by offset 200", 200, bench.read(x.present_position) - before)


def profiles() -> Iterator[Fact]:
    """Yield facts about velocity-based and time-based profiles, and the moving status."""
    bench = FactBench(x.XL430_W250)
    bench.write_all({x.velocity_limit: 20, x.profile_velocity: 60, x.torque_enable: 1, x.goal_position: 4000})
    bench.wait(0.4)
    yield Fact("profiles", "profile velocity, not the velocity limit", 60.0, float(bench.read(x.velocity_trajectory)))
    bench = FactBench(x.XL430_W250)
    bench.write_all({x.drive_mode: x.TIME_BASED_PROFILE, x.profile_velocity: 800, x.profile_acceleration: 200})
    bench.write_all({x.torque_enable: 1, x.goal_position: 2848})
    bench.wait(0.4)
    yield Fact("profiles", "time-based: half the path at half time", 2448.0, float(bench.read(x.position_trajectory)))
    bench.wait(0.41)
    yield Fact("profiles", "time-based: at the goal after the whole time", 2848, bench.read(x.position_trajectory))
    for velocity, acceleration, kind in ((0, 0, 0), (30, 0, 1), (500, 5, 2), (30, 2000, 3)):
        bench = FactBench(x.XL430_W250)
        bench.write_all({x.profile_acceleration: acceleration, x.profile_velocity: velocity, x.torque_enable: 1})
        bench.write(x.goal_position, 2600)
        bench.wait(0.1)
        yield Fact("profiles", f"moving status: profile type {kind}", kind, bench.read(x.moving_status) >> 4)
    tick = bench.read(x.realtime_tick)
    bench.wait(0.5)
    yield Fact("profiles", "realtime tick after 0.5 s", 500.0, float(bench.read(x.realtime_tick) - tick))


def bus() -> Iterator[Fact]:
    """Yield facts about group reads, the secondary ID, the clear instruction, factory reset and the bus watchdog."""
    group = (x.XL430_W250, x.XM430_W350, x.XL430_W250)
    reads = (
        ("sync read", Code.SYNC_READ, span(132, 4) + bytes((1, 2, 3))),
        ("bulk read", Code.BULK_READ, b"".join(bytes((i,)) + span(132, 4) for i in (1, 2, 3))),
    )
    for name, code, parameters in reads:
        bench = FactBench(*group)
        bench.line.faults.silence(2)
        heard = [servo_id for servo_id, _ in bench.send(code, parameters)]
        yield Fact("bus", f"{name}: servos that reply while servo 2 of 3 is silent", [1], heard, "I 364")
    bench = FactBench(*group)
    for servo in bench.line.servos:
        servo.memory.put(x.secondary_id, 9)
    heard = [servo_id for servo_id, _ in bench.send(Code.WRITE, b"\x41\0\x01", 9)]
    lit = [servo.memory.get(x.led) for servo in bench.line.servos]
    yield Fact("bus", "secondary ID: all servos obey, no servo replies", ([1, 1, 1], []), (lit, heard))
    for firmware, kept in ((42, 5), (41, 0)):
        bench = FactBench(x.XL430_W250, firmware=firmware)
        bench.write(x.homing_offset, 5)
        bench.send(Code.FACTORY_RESET, b"\xff")
        yield Fact(
            "bus", f"V{firmware}: homing offset after a broadcast factory reset", kept, bench.read(x.homing_offset)
        )
    clear = FactBench(x.XL430_W250).send(Code.CLEAR, b"\x01\x44\x58\x4c\x22", 1)
    yield Fact("bus", "clear instruction: reply without an error", [(1, 0)], clear)
    bench = FactBench(x.XL430_W250)
    bench.write_all({x.torque_enable: 1, x.bus_watchdog: 5})
    bench.wait(0.2)
    yield Fact("bus", "watchdog: register", 255, bench.read(x.bus_watchdog))
    yield Fact("bus", "watchdog: error for a goal", DATA_RANGE, bench.write(x.goal_position, 2048))
    yield Fact("bus", "watchdog: cleared by 0", [0, 0], bench.write_all({x.bus_watchdog: 0, x.goal_position: 2048}))


_FACTORY: Final = (
    *((model, x.pwm_slope, 140) for model in x.MODELS.values() if x.pwm_slope in model.own),
    (x.MX_28_2, x.acceleration_limit, 32767),
    (x.XC430_W150, x.moving_threshold, 20),
)


def factory() -> Iterator[Fact]:
    """Yield facts about the factory values."""
    for model, register, value in _FACTORY:
        yield Fact("factory", f"{model.name}: {register.name}", value, FactBench(model).read(register))


def facts() -> list[Fact]:
    """Return all facts, together with the behavior of the virtual servos."""
    return [fact for part in (errors, modes, positions, profiles, bus, factory) for fact in part()]
