"""A second implementation of an STS servo, slow and simple, to check the compiled implementation.

This implementation uses objects instead of a record, names instead of addresses, and Python integers. It works with
decoded settings and shares no code with ``sim_backend.servos.sts``.
"""

import math
from dataclasses import dataclass, field


def toward_zero(numerator: int, denominator: int) -> int:
    whole = abs(numerator) // denominator
    return whole if numerator >= 0 else -whole


def within(value: int, bound: int) -> int:
    return min(bound, max(-bound, value))


@dataclass
class Settings:
    """Decoded values of the registers that the servo uses."""

    min_position: int = 0
    max_position: int = 4095
    max_temperature: int = 70
    max_voltage: int = 140
    min_voltage: int = 40
    phase: int = 12
    unloading: int = 44
    p: int = 32
    d: int = 32
    i: int = 0
    punch: int = 16
    i_limit: int = 0
    dead_above: int = 1
    dead_below: int = 1
    current_limit: int = 310
    resolution: int = 1
    offset: int = 0
    mode: int = 0
    protective: int = 20
    protection_10ms: int = 200
    overload: int = 80
    speed_p: int = 10
    overcurrent_10ms: int = 200
    speed_i: int = 200
    torque: int = 0
    acceleration: int = 0
    goal: int = 0
    pwm: int = 0
    speed: int = 0
    torque_limit: int = 1000
    quiet_counts: int = 2
    d_ms: int = 20
    default_acceleration: int = 100
    acceleration_factor: int = 1

    @property
    def by_position(self) -> bool:
        return self.mode in (0, 3)

    def goal_speed(self) -> int:
        counts_s = self.speed if self.phase & 4 else self.speed * 50
        return 0 if counts_s == 0 else int(math.copysign(min(7500, max(50, abs(counts_s))), counts_s))

    def change_per_ms(self) -> int:
        return self.acceleration or self.default_acceleration * self.acceleration_factor


class Encoder:
    """Encoder that converts the angle to counts with turns and a filter, and measures the speed every 20 ms."""

    LAG_S = 0.0018

    def __init__(self, angle_rad: float, settings: Settings) -> None:
        self.settings = settings
        self.fails = False
        self.angle = angle_rad
        self.turn = 0
        self.count = self.last = self._look()
        self.age = 0
        self.snapshot = self.count
        self.speed = 0

    def _look(self) -> int:
        self.raw = math.floor(self.angle * 4096 / (2 * math.pi)) % 4096
        return (self.raw - (self.settings.offset if self.settings.by_position else 0)) % 4096

    def lag(self, angle_rad: float, dt_s: float) -> None:
        self.angle += (angle_rad - self.angle) * dt_s / (self.LAG_S + dt_s)

    def read(self) -> None:
        if not self.fails:
            now = self._look()
            step = now - self.last
            self.turn += -1 if step > 2048 else 1 if step < -2048 else 0
            self.last = now
            self.count = toward_zero(2 * self.count + 8 * (now + 4096 * self.turn), 10)
        self.age += 1
        if self.age == 20:
            self.age = 0
            travelled = self.count - self.snapshot
            self.speed = travelled if abs(travelled) >= self.settings.quiet_counts else 0
            self.snapshot = self.count


@dataclass
class Trapezoid:
    """Motion profile, which consists of the set-point in 1/10000 count and its speed."""

    settings: Settings
    goal: int = 0
    place: int = 0
    speed: int = 0
    ready: bool = False

    def __post_init__(self) -> None:
        self.top = 0
        self.take_speed()
        self.change = self.settings.change_per_ms()

    def take_speed(self) -> None:
        top = 10 * self.settings.goal_speed()
        if self.settings.mode != 1:
            top = abs(top) or (75000 if self.settings.phase & 8 else 0)
        self.ready = self.ready and top == self.top
        self.top = top

    def pin(self, count: int) -> None:
        self.goal, self.place, self.speed, self.ready = count, count * 10000, 0, False

    @property
    def done(self) -> bool:
        return self.speed == 0 and (self.place == self.goal * 10000 or self.top == 0)

    def take(self) -> None:
        wanted = self.settings.goal * (self.settings.resolution or 1)
        if self.settings.mode == 3:
            wanted += self.goal
        if self.settings.min_position != self.settings.max_position:
            if wanted < self.settings.min_position:
                wanted = self.settings.min_position
            elif wanted > self.settings.max_position:
                wanted = self.settings.max_position
        self.ready = self.ready and wanted == self.goal
        self.goal = wanted

    def advance(self) -> None:
        left = self.goal * 10000 - self.place
        if not self.change:
            self._go(left, self.top)
        elif not left or not self.top:
            self.speed = self._slower(self.speed)
            self.place += self.speed
        else:
            ahead = self.speed if left > 0 else -self.speed
            self.ready = self.ready or (ahead >= 0 and self._stop(ahead) <= abs(left))
            if self.ready:
                braking = self._stop(ahead) >= abs(left)
                self._go(left, max(500, ahead - self.change if braking else min(self.top, ahead + self.change)))
            else:
                self.speed = self._slower(self.speed, exact=ahead >= 0)
                self.place += self.speed

    def _stop(self, speed: int) -> int:
        """Return the sum of all speeds until rest, each of which is smaller by ``change`` than the one before."""
        return sum(range(speed % self.change, speed, self.change))

    def _slower(self, speed: int, exact: bool = True) -> int:
        """Return a speed closer to 0, or 0 below the minimum speed."""
        size = abs(speed) - self.change
        return 0 if size < 500 or (size == 500 and not exact) else int(math.copysign(size, speed))

    def _go(self, left: int, step: int) -> None:
        if not left:
            return
        if step >= abs(left):
            self.place, self.speed = self.goal * 10000, 0
        else:
            self.speed = step if left > 0 else -step
            self.place += self.speed

    def ramp(self, count: int) -> None:
        wanted, change = self.top, self.change
        missing = wanted - self.speed
        self.speed = wanted if not change else self.speed + within(missing, change)
        self.goal, self.place = count, count * 10000


@dataclass
class Loop:
    """Control loop: converts the error to a drive. Positive drive turns the shaft toward smaller counts."""

    settings: Settings
    total: int = 0
    lost_drive: int = 0
    lost_integral: int = 0
    age: int = 0
    before: int = 0
    change: int = 0

    def rest(self) -> None:
        self.total = self.lost_drive = self.lost_integral = self.before = self.change = 0

    def position(self, position: int, setpoint: int, still: bool) -> int:
        s, error = self.settings, position - setpoint
        if error > s.dead_above:
            error -= s.dead_above
        elif error < -s.dead_below:
            error += s.dead_below
        else:
            error = 0
        self.age += 1
        if self.age >= s.d_ms:
            self.age = 0
            self.change = error - self.before
            if abs(self.change) < s.quiet_counts:
                self.change = 0
            self.before = error
        drive = toward_zero(error * s.p, 4) + toward_zero(self.change * s.d, 8)
        return self._out(drive + self._integral(error, still))

    def _integral(self, error: int, still: bool) -> int:
        s = self.settings
        if not s.i:
            self.total = self.lost_integral = 0
            return 0
        if still:
            self.total += error - self.lost_drive - self.lost_integral
        whole = toward_zero(self.total * s.i, 500)
        kept = within(whole, 4 * s.i_limit) if s.i_limit else whole
        self.lost_integral = whole - kept
        return kept

    def speed(self, measured: int, wanted: int) -> int:
        s, error = self.settings, measured - wanted
        self.total = self.total + error - self.lost_drive if s.speed_i else 0
        return self._out(toward_zero(error * s.speed_p, 10) + toward_zero(self.total * s.speed_i, 1000))

    def _out(self, drive: int) -> int:
        if drive > 0:
            drive += self.settings.punch
        elif drive < 0:
            drive -= self.settings.punch
        kept = within(drive, self.settings.torque_limit)
        self.lost_drive = drive - kept
        return kept


@dataclass
class Guard:
    """Protection: the status bits and their effects."""

    settings: Settings
    bits: set[int] = field(default_factory=set)
    over_v_ms: int = 0
    hot_ms: int = 0
    over_a_ms: int = 0
    pushed: int = 0
    pushed_ms: int = 0
    pushed_from: int = 0

    @property
    def status(self) -> int:
        return sum(1 << bit for bit in self.bits)

    def acts(self, *bits: int) -> bool:
        return any(bit in self.bits and self.settings.unloading >> bit & 1 for bit in bits)

    def _say(self, bit: int, yes: bool) -> None:
        (self.bits.add if yes else self.bits.discard)(bit)

    def encoder(self, fails: bool) -> None:
        self._say(1, fails)

    def supply(self, voltage: int, temperature: int) -> None:
        s = self.settings
        self.over_v_ms = self.over_v_ms + 1 if voltage > s.max_voltage else 0
        self.hot_ms = self.hot_ms + 1 if temperature > s.max_temperature else 0
        in_range = s.min_voltage <= voltage <= s.max_voltage
        if in_range or voltage < s.min_voltage or self.over_v_ms >= 51:
            self._say(0, not in_range)
        if self.hot_ms >= 51 or temperature < s.max_temperature - 5:
            self._say(2, self.hot_ms >= 51)

    def current(self, units: int) -> None:
        s = self.settings
        watched = s.current_limit and s.overcurrent_10ms
        over = bool(watched and units >= s.current_limit)
        self.over_a_ms = self.over_a_ms + 1 if over else 0
        if self.over_a_ms > s.overcurrent_10ms * 10:
            self.bits.add(3)
        elif not watched or (not over and s.torque == 1):
            self.bits.discard(3)
        if self.acts(3):
            s.torque = 0

    def push(self, asked: int, snapshot: int) -> None:
        s = self.settings
        if s.torque != 1 or asked * self.pushed < s.protective * 10:
            self.pushed = 0
            self.bits.discard(5)
        elif 5 not in self.bits and abs(snapshot - self.pushed_from) > 50:
            self.pushed = 0
        if not self.pushed and s.torque == 1 and abs(asked) > s.overload * 10:
            self.pushed, self.pushed_ms, self.pushed_from = (1 if asked > 0 else -1), 0, snapshot
        if self.pushed:
            self.pushed_ms += 1
            if self.pushed_ms > s.protection_10ms * 10:
                self.bits.add(5)


class PlainServo:
    """The whole servo. ``settings`` may be changed between two steps, and goals are changed with ``write_goal``."""

    def __init__(self, settings: Settings, angle_rad: float, kt: float, ke: float, ohm: float) -> None:
        self.settings = settings
        self.encoder = Encoder(angle_rad, settings)
        self.profile = Trapezoid(settings)
        self.profile.pin(self.encoder.count)
        self.loop = Loop(settings)
        self.guard = Guard(settings)
        self.kt, self.ke, self.ohm = kt, ke, ohm
        self.current_a = 0.0
        self.drive = 0
        self.moving = False
        self._goal_written = False

    def write_goal(self) -> None:
        """Report that the goal of the mode has been written."""
        self._goal_written = True

    def step(self, angle_rad: float, velocity_rad_s: float, voltage_v: float, temperature: int) -> float:
        self.encoder.lag(angle_rad, 0.001)
        units = min(1023, int(abs(self.current_a) / 0.0065))
        self._millisecond(int(voltage_v * 10 + 0.5), temperature, units)
        self.current_a = 0.0
        if self.settings.torque in (1, 2):
            self.current_a = (-within(self.drive, 970) / 1000 * voltage_v - self.ke * velocity_rad_s) / self.ohm
        return self.kt * self.current_a

    def _millisecond(self, voltage: int, temperature: int, units: int) -> None:
        s, seen, guard = self.settings, self.encoder, self.guard
        seen.read()
        guard.encoder(seen.fails)
        if self._goal_written:
            self._goal_written = False
            s.torque = 1
            if s.by_position:
                self.profile.take()
            elif s.mode == 1:
                self.profile.take_speed()
        guard.supply(voltage, temperature)
        guard.current(units)
        driving, dead = s.torque == 1, guard.acts(0, 2)
        if driving and not dead and s.by_position:
            self.profile.advance()
        elif driving and not dead and s.mode == 1:
            self.profile.ramp(seen.count)
        else:
            self.profile.pin(seen.count)
        asked = self._asked() if driving else 0
        if not driving:
            self.loop.rest()
        guard.push(asked, seen.snapshot)
        if guard.acts(5) and s.mode != 2:
            asked = guard.pushed * s.protective * 10
        self.drive = 0 if dead or guard.acts(1) else within(asked, 970 if s.current_limit else 65535)
        running = not self.profile.done if s.by_position else False
        self.moving = running or (seen.speed != 0 and (self.moving or not s.by_position))

    def _asked(self) -> int:
        s = self.settings
        if s.by_position:
            calm = self.encoder.speed == 0 and not any(s.unloading >> bit & 1 for bit in self.guard.bits)
            setpoint = toward_zero(self.profile.place, 10000)
            return self.loop.position(self.encoder.count, setpoint, calm)
        if s.mode == 1:
            return self.loop.speed(self.encoder.speed, toward_zero(self.profile.speed, 500))
        return within(s.pwm, s.torque_limit) if s.mode == 2 else 0

    @property
    def shown_position(self) -> int:
        if self.settings.mode == 3:
            return toward_zero(self.profile.goal - self.encoder.count, self.settings.resolution or 1)
        count = self.encoder.count if self.settings.mode == 0 else self.encoder.raw
        return toward_zero(count, self.settings.resolution or 1) if self.settings.phase & 16 else count % 4096
