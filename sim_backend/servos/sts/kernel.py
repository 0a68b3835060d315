"""One millisecond of an STS servo, in the servo's own integers, as machine code.

One function for each part of the firmware. A section is a row of the table in docs/simulation.md, which has the
sources. Units: u of drive (1/1000 of full), counts (1/4096 turn), ms; the profile counts in 1/10000 count and 1/10000
count per ms. Positive drive turns the shaft towards smaller counts. Registers stand by address, as in Feetech's table.

All of it is one file because numba looks only at a function's own file when it decides whether what it keeps is stale.
"""

from math import floor, pi
from typing import Any, Final

from sim_backend.compiled import compiled
from sim_backend.mechanics.gears import Floats
from sim_backend.mechanics.plant import ShaftTable
from sim_backend.servos.sts.state import States, Supplies

Record = Any
"""One record of ``sim_backend.servos.sts.state.STATE``: numba has no name for its type."""

TICK_NS: Final = 1_000_000
TURN: Final = 4096
COUNTS_PER_RAD: Final = TURN / (2.0 * pi)
FINE: Final = 10_000
"""Steps of the profile in a count."""
FINE_PER_MS: Final = 10
"""1/10000 count per ms in a count per second."""
BRIDGE_LIMIT: Final = 970
SPEED_UNIT: Final = 50
"""Counts per second in one unit of a speed that is shown, and in one of the highest speed (84)."""

GOAL_NOTED, PWM_NOTED, SPEED_NOTED, SWITCH_NOTED, RAMP_NOTED = 1, 2, 4, 8, 16
POSITION, VELOCITY, PWM, STEP = 0, 1, 2, 3
"""Operating modes."""
COUNTS_PER_S_BIT, FULL_SPEED_BIT, UNFOLDED_BIT = 1 << 2, 1 << 3, 1 << 4
"""Bits of the phase register."""
VOLTAGE, ENCODER, TEMPERATURE, CURRENT, OVERLOAD = 1, 2, 4, 8, 32
"""Bits of the status."""
HOLD_OFF_MS: Final = 51
COOL_DOWN_C: Final = 5
MOVED_COUNTS: Final = 50
CURRENT_UNIT_A: Final = 0.0065
LARGEST_CURRENT: Final = 1023
LARGEST_SHOWN: Final = 0x7FFE
"""Of a position in steps of several counts."""


@compiled
def quotient(a: int, b: int) -> int:
    """``a / b`` rounded towards zero, as C does."""
    return a // b if a >= 0 else -(-a // b)


@compiled
def byte(s: Record, address: int) -> int:
    value: int = s.table[address] + 0  # wider than the byte itself
    return value


@compiled
def word(s: Record, address: int) -> int:
    return byte(s, address) + 256 * byte(s, address + 1)


@compiled
def signed(s: Record, address: int, sign_bit: int) -> int:
    value = word(s, address)
    magnitude = value & ((1 << sign_bit) - 1)
    return -magnitude if value >> sign_bit & 1 else magnitude


@compiled
def put_word(s: Record, address: int, value: int) -> None:
    s.table[address] = value & 0xFF
    s.table[address + 1] = value >> 8 & 0xFF


@compiled
def put_signed(s: Record, address: int, value: int, sign_bit: int) -> None:
    """Sign and magnitude; what does not fit loses its high bits."""
    magnitude = abs(value) & ((1 << sign_bit) - 1)
    put_word(s, address, magnitude | (1 << sign_bit if value < 0 else 0))


@compiled
def homing_offset(s: Record) -> int:
    """Register 31: bits 0 to 10 and 12 are the size, bit 11 the sign; with bit 15 it is two's complement."""
    value = word(s, 31)
    if value >= 1 << 15:
        return value - (1 << 16)
    if value >= 1 << 13:
        return 0
    size = (value & 0x7FF) + (0x800 if value & 1 << 12 else 0)
    return -size if value & 1 << 11 else size


@compiled
def clip(value: int, limit: int) -> int:
    return max(-limit, min(limit, value))


@compiled
def counts_turns(s: Record) -> bool:
    """Whether the mode is one of those that work on positions."""
    return byte(s, 33) == POSITION or byte(s, 33) == STEP


# What it sees (section 6).


@compiled
def sense(s: Record) -> None:
    """Read the encoder, if it answers, and count how far the shaft has come."""
    if s.encoder_fails:
        s.status |= ENCODER
    else:
        s.status &= ~ENCODER
        see(s)
    s.window_age_ms += 1
    if s.window_age_ms >= s.window_ms:
        moved = s.position - s.window_position
        s.window_counts = 0 if abs(moved) < byte(s, 80) else moved
        s.window_position, s.window_age_ms = s.position, 0


@compiled
def see(s: Record) -> None:
    """Take the encoder's angle; follow it over the seam where the mode counts turns."""
    raw = floor(s.lagged_rad * COUNTS_PER_RAD) % TURN
    mode = byte(s, 33)
    offset = homing_offset(s) if counts_turns(s) else 0
    reading = (raw - offset) % TURN
    if s.recount or mode != s.mode or offset != s.offset:
        jump_to(s, reading, s.recount != 0 or mode != s.mode)
        if mode != s.mode:
            begin_profile(s)
        s.recount, s.mode, s.offset = 0, mode, offset
    else:
        if reading - s.reading > TURN // 2:
            s.turns -= 1
        elif reading - s.reading < -(TURN // 2):
            s.turns += 1
        s.position = quotient(2 * s.position + 8 * (reading + s.turns * TURN), 10)
    s.raw, s.reading = raw, reading


@compiled
def jump_to(s: Record, reading: int, forget_turns: bool) -> None:
    """Another frame for the same shaft: the set-point jumps along, and the shaft has not moved."""
    if forget_turns:
        s.turns = 0
    position = reading + s.turns * TURN
    s.window_position += position - s.position
    s.push_position += position - s.position
    s.position = position
    s.setpoint_e4, s.speed_e4, s.planned = position * FINE, 0, 0
    if forget_turns:
        s.goal = position


# Goals (sections 4, 5).


@compiled
def take_writes(s: Record) -> None:
    """Do what the last write asked for: torque on by a goal, and the goal itself."""
    noted, mode = s.noted, byte(s, 33)
    s.noted = 0
    goal_of_mode = GOAL_NOTED
    if mode == VELOCITY:
        goal_of_mode = SPEED_NOTED
    elif mode == PWM:
        goal_of_mode = PWM_NOTED
    if noted & goal_of_mode and s.goal_write_energises and mode <= STEP:
        s.table[40] = 1
    switched_on = byte(s, 40) == 1 and not s.on
    stale = switched_on and noted & SWITCH_NOTED and s.torque_on_takes_goal
    if byte(s, 40) == 1 and counts_turns(s) and (noted & GOAL_NOTED or stale):
        take_goal(s)
    if noted & SPEED_NOTED and mode != PWM and mode <= STEP:
        take_speed(s)
    if noted & RAMP_NOTED:
        take_ramp(s)


@compiled
def begin_profile(s: Record) -> None:
    """Take what the profile goes by, after power-on and in another mode."""
    take_speed(s)
    take_ramp(s)


@compiled
def take_goal(s: Record) -> None:
    """The goal register, in the angle's resolution and between the limits."""
    goal = signed(s, 42, 15) * max(1, byte(s, 30))
    if byte(s, 33) == STEP:
        goal += s.goal
    lowest, highest = word(s, 9), word(s, 11)
    if lowest != highest and goal < lowest:
        goal = lowest
    elif lowest != highest and goal > highest:
        goal = highest
    if goal != s.goal:
        s.goal, s.planned = goal, 0


@compiled
def asked_speed(s: Record) -> int:
    """Register 46 in counts per second, with its sign and within the factory's limits."""
    speed = signed(s, 46, 15)
    if not byte(s, 18) & COUNTS_PER_S_BIT:
        speed *= s.windows_s
    if speed == 0:
        return 0
    size: int = min(max(abs(speed), s.lowest_counts_s), s.highest_counts_s)
    return size if speed > 0 else -size


@compiled
def take_speed(s: Record) -> None:
    """Register 46 and the phase register's bits for it, which count until 46 is written again."""
    top = asked_speed(s)
    if byte(s, 33) != VELOCITY:
        top = abs(top)
        if top == 0 and byte(s, 18) & FULL_SPEED_BIT:
            top = s.highest_counts_s
    if top * FINE_PER_MS != s.top_e4:
        s.top_e4, s.planned = top * FINE_PER_MS, 0


@compiled
def take_ramp(s: Record) -> None:
    """Registers 41, 85 and 86, which count until 41 is written again: how much the speed may change; 0: no limit."""
    ramp, largest = byte(s, 41), byte(s, 85)
    if ramp == 0:
        ramp = largest * byte(s, 86)
    elif largest and ramp > largest:
        s.table[41] = ramp = largest
    if ramp != s.ramp_e4:
        s.ramp_e4, s.planned = ramp, 0


@compiled
def follow_shaft(s: Record) -> None:
    """Set-point and goal where the shaft is, at rest."""
    s.goal = s.position
    s.setpoint_e4, s.speed_e4, s.planned = s.position * FINE, 0, 0


@compiled
def advance_profile(s: Record) -> None:
    """Move the set-point by a trapezoid towards the goal (section 5)."""
    left = s.goal * FINE - s.setpoint_e4
    way, distance = 1 if left >= 0 else -1, abs(left)
    if s.ramp_e4 == 0:
        if distance:
            move_setpoint(s, way, s.top_e4, distance)
    elif distance == 0 or s.top_e4 == 0:
        come_to_rest(s)
    else:
        if not s.planned:
            prepare(s, way, distance)
        if s.planned:
            approach(s, way, distance)


@compiled
def braking_distance(speed: int, ramp: int) -> int:
    """How far the set-point goes while it loses ``ramp`` of its speed each millisecond."""
    steps = speed // ramp
    return max(0, steps * (2 * speed - (steps + 1) * ramp) // 2)


@compiled
def move_setpoint(s: Record, way: int, speed: int, distance: int) -> None:
    """One millisecond at this speed; never past the goal, where it rests."""
    if speed >= distance:
        s.setpoint_e4, s.speed_e4 = s.goal * FINE, 0
    else:
        s.setpoint_e4 += way * speed
        s.speed_e4 = way * speed


@compiled
def come_to_rest(s: Record) -> None:
    """Brake where there is no way to go."""
    way, speed = 1 if s.speed_e4 >= 0 else -1, abs(s.speed_e4) - s.ramp_e4
    s.speed_e4 = way * speed if speed > 0 and speed >= s.lowest_counts_s * FINE_PER_MS else 0
    s.setpoint_e4 += s.speed_e4


@compiled
def prepare(s: Record, way: int, distance: int) -> None:
    """After a change: brake until the goal lies ahead and can be met; that may take the set-point past it."""
    speed, slowest = s.speed_e4 * way, s.lowest_counts_s * FINE_PER_MS
    if speed < 0:
        speed += s.ramp_e4
        speed = speed if speed < -slowest else 0
    elif braking_distance(speed, s.ramp_e4) <= distance:
        s.planned = 1
        return
    else:
        speed -= s.ramp_e4
        speed = speed if speed >= slowest else 0
    s.speed_e4 = way * speed
    s.setpoint_e4 += s.speed_e4


@compiled
def approach(s: Record, way: int, distance: int) -> None:
    """A goal that can be met: speed up to 46, brake in time, stop on it."""
    speed = s.speed_e4 * way
    if braking_distance(speed, s.ramp_e4) >= distance:
        speed -= s.ramp_e4
    else:
        speed = min(speed + s.ramp_e4, s.top_e4)
    move_setpoint(s, way, max(speed, s.lowest_counts_s * FINE_PER_MS), distance)


@compiled
def ramp_speed(s: Record) -> None:
    """Move the set speed of mode 1 towards register 46 (section 4)."""
    wanted, change = s.top_e4, s.ramp_e4
    s.speed_e4 = wanted if change == 0 else min(max(wanted, s.speed_e4 - change), s.speed_e4 + change)
    s.goal = s.position
    s.setpoint_e4 = s.position * FINE


@compiled
def profile_runs(s: Record) -> bool:
    """Whether the set-point moves, or would at the next chance: not at speed 0."""
    return bool(s.speed_e4 != 0 or (s.setpoint_e4 != s.goal * FINE and s.top_e4 != 0))


@compiled
def profile_speed(s: Record) -> int:
    """The profile's speed as the encoder's is measured: whole counts in a window."""
    return quotient(s.speed_e4, FINE_PER_MS * s.windows_s)


# The loops (sections 3 and 4).


@compiled
def limited(s: Record, drive: int) -> int:
    """The offset that helps against friction, and the torque limit; what the limit cuts off is remembered."""
    if drive:
        drive += byte(s, 24) if drive > 0 else -byte(s, 24)
    cut = clip(drive, word(s, 48))
    s.drive_cut = drive - cut
    return cut


@compiled
def position_loop(s: Record) -> int:
    """The drive that the position error asks for (section 3)."""
    error = s.position - quotient(s.setpoint_e4, FINE)
    if error > byte(s, 26):
        error -= byte(s, 26)
    elif error < -byte(s, 27):
        error += byte(s, 27)
    else:
        error = 0
    s.error_age_ms += 1
    if s.error_age_ms >= byte(s, 81):
        change = error - s.error_then
        s.error_change = 0 if abs(change) < byte(s, 80) else change
        s.error_then, s.error_age_ms = error, 0
    drive = quotient(error * byte(s, 21), 4) + quotient(s.error_change * byte(s, 22), 8)
    return limited(s, drive + integral(s, error))


@compiled
def integral(s: Record, error: int) -> int:
    """The share of the summed error, which grows only at standstill."""
    gain = byte(s, 23)
    if gain == 0:
        s.error_sum = 0
        s.integral_cut = 0
        return 0
    if s.window_counts == 0 and not s.status & byte(s, 19):
        s.error_sum += error - s.drive_cut - s.integral_cut
    share = quotient(s.error_sum * gain, 500)
    bound = 4 * byte(s, 25)
    kept = clip(share, bound) if bound else share
    s.integral_cut = share - kept
    return kept


@compiled
def velocity_loop(s: Record) -> int:
    """The drive that the speed's error asks for, in counts of one window (section 4)."""
    error, gain = s.window_counts - profile_speed(s), byte(s, 39)
    s.error_sum = s.error_sum + error - s.drive_cut if gain else 0
    return limited(s, quotient(error * byte(s, 37), 10) + quotient(s.error_sum * gain, 1000))


@compiled
def asked_drive(s: Record) -> int:
    """What the mode's own loop wants."""
    mode = byte(s, 33)
    if mode in (POSITION, STEP):
        return position_loop(s)
    if mode == VELOCITY:
        return velocity_loop(s)
    if mode == PWM:
        return clip(signed(s, 44, 10), word(s, 48))
    return 0


@compiled
def rest_loops(s: Record) -> None:
    """No memory of what was before the torque went off."""
    s.error_then = s.error_change = s.error_sum = s.drive_cut = s.integral_cut = 0


# Protection (section 8).


@compiled
def watch_supply(s: Record) -> None:
    """Voltage and heat against their limits."""
    voltage, temperature = byte(s, 62), byte(s, 63)
    s.high_voltage_ms = s.high_voltage_ms + 1 if voltage > byte(s, 14) else 0
    s.hot_ms = s.hot_ms + 1 if temperature > byte(s, 13) else 0
    if voltage < byte(s, 15) or s.high_voltage_ms >= HOLD_OFF_MS:
        s.status |= VOLTAGE
    elif voltage <= byte(s, 14):
        s.status &= ~VOLTAGE
    if s.hot_ms >= HOLD_OFF_MS:
        s.status |= TEMPERATURE
    elif temperature < byte(s, 13) - COOL_DOWN_C:
        s.status &= ~TEMPERATURE


@compiled
def watch_current(s: Record) -> None:
    """Too much current for too long; acting, it takes the torque away."""
    limit, longest_ms = word(s, 28), 10 * byte(s, 38)
    watched = limit > 0 and longest_ms > 0
    over = watched and word(s, 69) >= limit
    s.overcurrent_ms = s.overcurrent_ms + 1 if over else 0
    if s.overcurrent_ms > longest_ms:
        s.status |= CURRENT
    elif not watched or (not over and byte(s, 40) == 1):
        s.status &= ~CURRENT
    if s.status & CURRENT & byte(s, 19):
        s.table[40] = 0


@compiled
def watch_push(s: Record, asked: int) -> None:
    """Overload: hard drive that does not move the shaft, for too long."""
    if byte(s, 40) != 1 or asked * s.push < 10 * byte(s, 34):
        s.push = 0
        s.status &= ~OVERLOAD
    elif not s.status & OVERLOAD and abs(s.window_position - s.push_position) > MOVED_COUNTS:
        s.push = 0
    if s.push == 0 and byte(s, 40) == 1 and abs(asked) > 10 * byte(s, 36):
        s.push = 1 if asked > 0 else -1
        s.push_ms, s.push_position = 0, s.window_position
    if s.push:
        s.push_ms += 1
        if s.push_ms > 10 * byte(s, 35):
            s.status |= OVERLOAD


@compiled
def protected(s: Record, asked: int) -> int:
    """The drive that the protections leave of what is asked."""
    if s.status & byte(s, 19) & OVERLOAD and byte(s, 33) != PWM:
        asked = s.push * 10 * byte(s, 34)
    return asked


# The millisecond (section 1).


@compiled
def tick(s: Record) -> None:
    """Everything that the firmware does once in a millisecond."""
    sense(s)
    take_writes(s)
    watch_supply(s)
    watch_current(s)
    on = byte(s, 40) == 1
    unsupplied = s.status & byte(s, 19) & (VOLTAGE | TEMPERATURE)
    if not on or unsupplied or (byte(s, 33) >= PWM and byte(s, 33) != STEP):
        follow_shaft(s)
    elif byte(s, 33) == VELOCITY:
        ramp_speed(s)
    else:
        advance_profile(s)
    if on:
        asked = asked_drive(s)
    else:
        rest_loops(s)
        asked = 0
    watch_push(s, asked)
    blind = s.status & byte(s, 19) & ENCODER
    s.drive = 0 if unsupplied or blind else protected(s, asked)
    if word(s, 28):  # with a limit of the current the bridge's limit shows, too
        s.drive = clip(s.drive, BRIDGE_LIMIT)
    s.on = on
    report(s)


@compiled
def folded(s: Record, position: int) -> int:
    """As it is shown outside mode 3: within a turn, or unfolded in units of 30."""
    return quotient(position, max(1, byte(s, 30))) if byte(s, 18) & UNFOLDED_BIT else position % TURN


@compiled
def steps(s: Record, counts: int) -> int:
    """Counts in units of 30, as mode 3 shows them."""
    return clip(quotient(counts, max(1, byte(s, 30))), LARGEST_SHOWN)


@compiled
def report(s: Record) -> None:
    """Show the state in the table (section 6)."""
    mode, speed_unit = byte(s, 33), SPEED_UNIT if byte(s, 18) & COUNTS_PER_S_BIT else 1
    if mode == STEP:
        put_signed(s, 56, steps(s, s.goal - s.position), 15)
    else:
        put_signed(s, 56, folded(s, s.position if mode == POSITION else s.raw), 15)
    put_signed(s, 58, s.window_counts * speed_unit, 15)
    put_signed(s, 60, s.drive, 10)
    s.table[65] = s.status
    if counts_turns(s):
        s.table[66] = profile_runs(s) or (byte(s, 66) != 0 and s.window_counts != 0)
    else:
        s.table[66] = s.window_counts != 0
    setpoint = quotient(s.setpoint_e4, FINE)
    put_signed(s, 67, steps(s, setpoint) if mode == STEP else folded(s, setpoint), 15)
    put_signed(s, 71, profile_speed(s) * speed_unit, 15)


@compiled
def measure(s: Record, voltage_v: float) -> None:
    """Show voltage, heat and current as the converter has them."""
    s.table[62] = max(0, min(255, int(voltage_v * 10.0 + 0.5)))
    s.table[63] = max(0, min(255, int(s.temperature_c + 0.5)))
    put_word(s, 69, min(LARGEST_CURRENT, int(abs(s.current_a) / CURRENT_UNIT_A)))


@compiled
def power_on(states: States, voltage_v: float) -> None:
    """Take what is only looked at when power comes on, and see the shaft."""
    s: Record = states[0]
    s.windows_s = max(1, byte(s, 82))
    s.window_ms = 1000 // s.windows_s
    s.lowest_counts_s, s.highest_counts_s = s.windows_s * byte(s, 83), SPEED_UNIT * byte(s, 84)
    begin_profile(s)
    look(states, voltage_v)


@compiled
def look(states: States, voltage_v: float) -> None:
    """See a shaft that was put where it is at once, with filters that have settled. Limp, it is in its first turn."""
    s: Record = states[0]
    s.recount = not s.on
    sense(s)
    s.position = s.reading + s.turns * TURN
    s.window_position, s.window_age_ms, s.window_counts = s.position, 0, 0
    if not s.on:
        follow_shaft(s)
    measure(s, voltage_v)
    report(s)


# Bridge and motor (sections 2 and 10).


@compiled
def turn_motor(s: Record, dt_s: float, velocity_rad_s: float, voltage_v: float) -> tuple[float, float]:
    """Torque on the shaft (N m), and the supply's current (A). Braking gives none back to the supply (assumed)."""
    duty = 0.0
    s.current_a = 0.0
    if byte(s, 40) == 1 or byte(s, 40) == 2:
        duty = -0.001 * clip(s.drive, BRIDGE_LIMIT)
        s.current_a = (duty * voltage_v - s.back_emf_v_s * velocity_rad_s) / s.resistance_ohm
    loss_w = s.current_a * s.current_a * s.resistance_ohm
    warm_c = s.ambient_c + loss_w * s.thermal_resistance_k_w - s.temperature_c
    s.temperature_c += warm_c * dt_s / s.thermal_time_s
    return s.torque_constant_nm_a * s.current_a, max(0.0, duty * s.current_a)


@compiled
def step(states: States, dt_s: float, angle_rad: float, velocity_rad_s: float, voltage_v: float) -> tuple[float, float]:
    """``dt_s`` of one servo, however many of its milliseconds that is: torque (N m), supply current (A)."""
    return pass_time(states[0], dt_s, angle_rad, velocity_rad_s, voltage_v)


@compiled
def pass_time(s: Record, dt_s: float, angle_rad: float, velocity_rad_s: float, voltage_v: float) -> tuple[float, float]:
    """``dt_s`` of one record, as ``step`` says."""
    if s.deaf_s > 0.0:
        s.deaf_s -= dt_s
    if not s.encoder_sticks:
        s.lagged_rad += (angle_rad - s.lagged_rad) * dt_s / (s.encoder_lag_s + dt_s)
    s.elapsed_ns += int(dt_s * 1e9 + 0.5)
    while s.elapsed_ns >= TICK_NS:
        s.elapsed_ns -= TICK_NS
        measure(s, voltage_v)
        tick(s)
    return turn_motor(s, dt_s, velocity_rad_s, voltage_v)


# Several servos (row 10 of the table).


@compiled
def share_supplies(states: States, supplies: Supplies) -> None:
    """Each supply's voltage sags by the current of all servos that hang on it."""
    for k in range(len(supplies)):
        total_a = 0.0
        for i in range(len(states)):
            if states[i].supply == k:
                total_a += states[i].supply_current_a
        supplies[k].left_v = max(0.0, supplies[k].voltage_v - total_a * supplies[k].resistance_ohm)
    for i in range(len(states)):
        states[i].voltage_v = supplies[states[i].supply].left_v


@compiled
def step_all(
    states: States,
    supplies: Supplies,
    shafts: ShaftTable,
    position: Floats,
    velocity: Floats,
    effort: Floats,
    dt_s: float,
) -> None:
    """``dt_s`` of all servos of a line, from the joints' positions and velocities to their efforts."""
    share_supplies(states, supplies)
    for i in range(len(states)):
        s: Record = states[i]
        shaft = shafts[i]
        angle_rad = position[shaft.position_at] * shaft.per_unit + shaft.zero_rad
        velocity_rad_s = velocity[shaft.velocity_at] * shaft.per_unit
        torque_nm, s.supply_current_a = pass_time(s, dt_s, angle_rad, velocity_rad_s, s.voltage_v)
        effort[shaft.effort_at] = torque_nm * shaft.per_unit
