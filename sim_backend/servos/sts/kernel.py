"""Firmware of an STS servo in steps of one millisecond, compiled to machine code.

Each function is one part of the firmware. The section numbers refer to the rows of the table in docs/simulation.md,
which lists the sources. Units: drive in 1/1000 of full drive, position in counts (1/4096 turn), time in ms. The motion
profile uses units of 1/10000 count and 1/10000 count per ms. Positive drive turns the shaft toward smaller counts.

All arithmetic uses integers, as in the servo. All compiled firmware code is in this file, because numba checks only a
function's own file when it decides whether cached machine code is stale.
"""

from math import floor, pi
from typing import Any, Final

from drivers.servos import sts
from sim_backend.compiled import compiled
from sim_backend.mechanics.gears import Floats
from sim_backend.mechanics.plant import ShaftTable
from sim_backend.servos.sts.state import States, Supplies

Record = Any
"""One record of ``sim_backend.servos.sts.state.STATE``. The type is Any, because numba cannot name the type of a
record."""

# Addresses in the control table, as module-level integers, which numba compiles into the code as constants.
MIN_POSITION: Final = sts.min_position.address
MAX_POSITION: Final = sts.max_position.address
MAX_TEMPERATURE: Final = sts.max_temperature.address
MAX_VOLTAGE: Final = sts.max_voltage.address
MIN_VOLTAGE: Final = sts.min_voltage.address
PHASE: Final = sts.phase.address
UNLOADING_CONDITION: Final = sts.unloading_condition.address
POSITION_P: Final = sts.position_p.address
POSITION_D: Final = sts.position_d.address
POSITION_I: Final = sts.position_i.address
MINIMUM_STARTUP_FORCE: Final = sts.minimum_startup_force.address
INTEGRAL_LIMIT: Final = sts.integral_limit.address
CW_DEAD_ZONE: Final = sts.cw_dead_zone.address
CCW_DEAD_ZONE: Final = sts.ccw_dead_zone.address
PROTECTION_CURRENT: Final = sts.protection_current.address
ANGULAR_RESOLUTION: Final = sts.angular_resolution.address
HOMING_OFFSET: Final = sts.homing_offset.address
OPERATING_MODE: Final = sts.operating_mode.address
PROTECTIVE_TORQUE: Final = sts.protective_torque.address
PROTECTION_TIME: Final = sts.protection_time.address
OVERLOAD_TORQUE: Final = sts.overload_torque.address
VELOCITY_P: Final = sts.velocity_p.address
OVERCURRENT_TIME: Final = sts.overcurrent_time.address
VELOCITY_I: Final = sts.velocity_i.address
TORQUE_ENABLE: Final = sts.torque_enable.address
ACCELERATION: Final = sts.acceleration.address
GOAL_POSITION: Final = sts.goal_position.address
GOAL_TIME: Final = sts.goal_time.address
GOAL_VELOCITY: Final = sts.goal_velocity.address
TORQUE_LIMIT: Final = sts.torque_limit.address
PRESENT_POSITION: Final = sts.present_position.address
PRESENT_VELOCITY: Final = sts.present_velocity.address
PRESENT_LOAD: Final = sts.present_load.address
PRESENT_VOLTAGE: Final = sts.present_voltage.address
PRESENT_TEMPERATURE: Final = sts.present_temperature.address
STATUS: Final = sts.status.address
MOVING: Final = sts.moving.address
PRESENT_TARGET: Final = sts.present_target.address
PRESENT_CURRENT: Final = sts.present_current.address
TARGET_VELOCITY: Final = 71  # not in the register table
MOVING_THRESHOLD: Final = sts.moving_threshold.address
DTS: Final = sts.dts.address
VELOCITY_UNIT: Final = sts.velocity_unit.address
HTS: Final = sts.hts.address
MAX_VELOCITY: Final = sts.max_velocity.address
MAX_ACCELERATION: Final = sts.max_acceleration.address
ACCELERATION_MULTIPLIER: Final = sts.acceleration_multiplier.address

TICK_NS: Final = 1_000_000
TURN: Final = 4096
COUNTS_PER_RAD: Final = TURN / (2.0 * pi)
FINE: Final = 10_000
"""Number of profile steps in one count."""
FINE_PER_MS: Final = 10
"""Profile speed that corresponds to one count per second, in 1/10000 count per ms."""
BRIDGE_LIMIT: Final = 970
SPEED_UNIT: Final = 50
"""Counts per second in one unit of a reported speed, and in one unit of ``MAX_VELOCITY``."""

GOAL_NOTED, PWM_NOTED, SPEED_NOTED, SWITCH_NOTED, RAMP_NOTED = 1, 2, 4, 8, 16
POSITION, VELOCITY, PWM, STEP = 0, 1, 2, 3
"""Operating modes."""
COUNTS_PER_S_BIT, FULL_SPEED_BIT, UNFOLDED_BIT = 1 << 2, 1 << 3, 1 << 4
"""Bits of the phase register."""
VOLTAGE, ENCODER, TEMPERATURE, CURRENT, OVERLOAD = 1, 2, 4, 8, 32
"""Bits of the status register."""
HOLD_OFF_MS: Final = 51
COOL_DOWN_C: Final = 5
MOVED_COUNTS: Final = 50
CURRENT_UNIT_A: Final = 0.0065
LARGEST_CURRENT: Final = 1023
LARGEST_SHOWN: Final = 0x7FFE
"""Largest position that step mode reports."""


@compiled
def quotient(a: int, b: int) -> int:
    """Return ``a / b``, rounded toward zero as in C."""
    return a // b if a >= 0 else -(-a // b)


@compiled
def byte(s: Record, address: int) -> int:
    value: int = s.table[address] + 0  # The addition widens the value beyond one byte.
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
    """Write a value in sign-magnitude format. If the magnitude is too large, its high bits are lost."""
    magnitude = abs(value) & ((1 << sign_bit) - 1)
    put_word(s, address, magnitude | (1 << sign_bit if value < 0 else 0))


@compiled
def homing_offset(s: Record) -> int:
    """Return the homing offset, in counts.

    Bits 0 to 10 and 12 are the magnitude and bit 11 is the sign. If bit 15 is set, the word is a two's complement
    number.
    """
    value = word(s, HOMING_OFFSET)
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
    """Return whether the operating mode is a position control mode."""
    return byte(s, OPERATING_MODE) == POSITION or byte(s, OPERATING_MODE) == STEP


# Sensing (section 6).


@compiled
def sense(s: Record) -> None:
    """Read the encoder, if it responds, and measure the speed over the current window."""
    if s.encoder_fails:
        s.status |= ENCODER
    else:
        s.status &= ~ENCODER
        see(s)
    s.window_age_ms += 1
    if s.window_age_ms >= s.window_ms:
        moved = s.position - s.window_position
        s.window_counts = 0 if abs(moved) < byte(s, MOVING_THRESHOLD) else moved
        s.window_position, s.window_age_ms = s.position, 0


@compiled
def see(s: Record) -> None:
    """Read the angle from the encoder and count turns. The homing offset applies only in position mode and step
    mode."""
    raw = floor(s.lagged_rad * COUNTS_PER_RAD) % TURN
    mode = byte(s, OPERATING_MODE)
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
    """Change the position reference without moving the shaft. The set-point changes together with the position."""
    if forget_turns:
        s.turns = 0
    position = reading + s.turns * TURN
    s.window_position += position - s.position
    s.push_position += position - s.position
    s.position = position
    s.setpoint_e4, s.speed_e4, s.planned = position * FINE, 0, 0
    if forget_turns:
        s.goal = position


# Goals (sections 4 and 5).


@compiled
def take_writes(s: Record) -> None:
    """Apply the last write: if a goal was written, enable torque and use the goal."""
    noted, mode = s.noted, byte(s, OPERATING_MODE)
    s.noted = 0
    goal_of_mode = GOAL_NOTED
    if mode == VELOCITY:
        goal_of_mode = SPEED_NOTED
    elif mode == PWM:
        goal_of_mode = PWM_NOTED
    if noted & goal_of_mode and s.goal_write_energises and mode <= STEP:
        s.table[TORQUE_ENABLE] = 1
    switched_on = byte(s, TORQUE_ENABLE) == 1 and not s.on
    stale = switched_on and noted & SWITCH_NOTED and s.torque_on_takes_goal
    if byte(s, TORQUE_ENABLE) == 1 and counts_turns(s) and (noted & GOAL_NOTED or stale):
        take_goal(s)
    if noted & SPEED_NOTED and mode != PWM and mode <= STEP:
        take_speed(s)
    if noted & RAMP_NOTED:
        take_ramp(s)


@compiled
def begin_profile(s: Record) -> None:
    """Load the motion profile settings after power-on or a mode change."""
    take_speed(s)
    take_ramp(s)


@compiled
def take_goal(s: Record) -> None:
    """Use the goal register as the new goal, scaled by the angular resolution and clipped to the position limits."""
    goal = signed(s, GOAL_POSITION, 15) * max(1, byte(s, ANGULAR_RESOLUTION))
    if byte(s, OPERATING_MODE) == STEP:
        goal += s.goal
    lowest, highest = word(s, MIN_POSITION), word(s, MAX_POSITION)
    if lowest != highest and goal < lowest:
        goal = lowest
    elif lowest != highest and goal > highest:
        goal = highest
    if goal != s.goal:
        s.goal, s.planned = goal, 0


@compiled
def asked_speed(s: Record) -> int:
    """Return the signed goal velocity in counts per second, clipped to the factory limits."""
    speed = signed(s, GOAL_VELOCITY, 15)
    if not byte(s, PHASE) & COUNTS_PER_S_BIT:
        speed *= s.windows_s
    if speed == 0:
        return 0
    size: int = min(max(abs(speed), s.lowest_counts_s), s.highest_counts_s)
    return size if speed > 0 else -size


@compiled
def take_speed(s: Record) -> None:
    """Latch the goal velocity. The phase register takes effect only when the goal velocity is written again."""
    top = asked_speed(s)
    if byte(s, OPERATING_MODE) != VELOCITY:
        top = abs(top)
        if top == 0 and byte(s, PHASE) & FULL_SPEED_BIT:
            top = s.highest_counts_s
    if top * FINE_PER_MS != s.top_e4:
        s.top_e4, s.planned = top * FINE_PER_MS, 0


@compiled
def take_ramp(s: Record) -> None:
    """Store the maximum change of speed per millisecond; 0 means that there is no limit.

    A change to the registers for the maximum and the multiplier takes effect only when the acceleration is written
    again.
    """
    ramp, largest = byte(s, ACCELERATION), byte(s, MAX_ACCELERATION)
    if ramp == 0:
        ramp = largest * byte(s, ACCELERATION_MULTIPLIER)
    elif largest and ramp > largest:
        s.table[ACCELERATION] = ramp = largest
    if ramp != s.ramp_e4:
        s.ramp_e4, s.planned = ramp, 0


@compiled
def follow_shaft(s: Record) -> None:
    """Set the set-point and the goal to the current shaft position, at rest."""
    s.goal = s.position
    s.setpoint_e4, s.speed_e4, s.planned = s.position * FINE, 0, 0


@compiled
def advance_profile(s: Record) -> None:
    """Move the set-point toward the goal with a trapezoidal speed profile (section 5)."""
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
    """Return the distance that the set-point covers while its speed falls by ``ramp`` each millisecond."""
    steps = speed // ramp
    return max(0, steps * (2 * speed - (steps + 1) * ramp) // 2)


@compiled
def move_setpoint(s: Record, way: int, speed: int, distance: int) -> None:
    """Move the set-point at this speed for one millisecond. The set-point stops at the goal."""
    if speed >= distance:
        s.setpoint_e4, s.speed_e4 = s.goal * FINE, 0
    else:
        s.setpoint_e4 += way * speed
        s.speed_e4 = way * speed


@compiled
def come_to_rest(s: Record) -> None:
    """Brake because the set-point is at the goal or the goal velocity is 0."""
    way, speed = 1 if s.speed_e4 >= 0 else -1, abs(s.speed_e4) - s.ramp_e4
    s.speed_e4 = way * speed if speed > 0 and speed >= s.lowest_counts_s * FINE_PER_MS else 0
    s.setpoint_e4 += s.speed_e4


@compiled
def prepare(s: Record, way: int, distance: int) -> None:
    """After a goal change, brake until the set-point can stop at the goal. The set-point may overshoot the goal
    first."""
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
    """Approach a goal at which the set-point can stop: accelerate to the top speed, brake in time and stop at the
    goal."""
    speed = s.speed_e4 * way
    if braking_distance(speed, s.ramp_e4) >= distance:
        speed -= s.ramp_e4
    else:
        speed = min(speed + s.ramp_e4, s.top_e4)
    move_setpoint(s, way, max(speed, s.lowest_counts_s * FINE_PER_MS), distance)


@compiled
def ramp_speed(s: Record) -> None:
    """In velocity mode, move the speed set-point toward the goal velocity (section 4)."""
    wanted, change = s.top_e4, s.ramp_e4
    s.speed_e4 = wanted if change == 0 else min(max(wanted, s.speed_e4 - change), s.speed_e4 + change)
    s.goal = s.position
    s.setpoint_e4 = s.position * FINE


@compiled
def profile_runs(s: Record) -> bool:
    """Return whether the set-point is moving or still has to move. If the top speed is 0, the set-point does not have
    to move."""
    return bool(s.speed_e4 != 0 or (s.setpoint_e4 != s.goal * FINE and s.top_e4 != 0))


@compiled
def profile_speed(s: Record) -> int:
    """Return the profile's speed in whole counts per window, the unit of the measured speed."""
    return quotient(s.speed_e4, FINE_PER_MS * s.windows_s)


# Control loops (sections 3 and 4).


@compiled
def limited(s: Record, drive: int) -> int:
    """Add the startup force to the drive, and clip the drive to the torque limit. The amount by which the drive exceeds
    the limit is stored."""
    if drive:
        drive += byte(s, MINIMUM_STARTUP_FORCE) if drive > 0 else -byte(s, MINIMUM_STARTUP_FORCE)
    cut = clip(drive, word(s, TORQUE_LIMIT))
    s.drive_cut = drive - cut
    return cut


@compiled
def position_loop(s: Record) -> int:
    """Return the drive computed from the position error (section 3)."""
    error = s.position - quotient(s.setpoint_e4, FINE)
    if error > byte(s, CW_DEAD_ZONE):
        error -= byte(s, CW_DEAD_ZONE)
    elif error < -byte(s, CCW_DEAD_ZONE):
        error += byte(s, CCW_DEAD_ZONE)
    else:
        error = 0
    s.error_age_ms += 1
    if s.error_age_ms >= byte(s, DTS):
        change = error - s.error_then
        s.error_change = 0 if abs(change) < byte(s, MOVING_THRESHOLD) else change
        s.error_then, s.error_age_ms = error, 0
    drive = quotient(error * byte(s, POSITION_P), 4) + quotient(s.error_change * byte(s, POSITION_D), 8)
    return limited(s, drive + integral(s, error))


@compiled
def integral(s: Record, error: int) -> int:
    """Return the integral term. The error sum grows only while the shaft is at rest."""
    gain = byte(s, POSITION_I)
    if gain == 0:
        s.error_sum = 0
        s.integral_cut = 0
        return 0
    if s.window_counts == 0 and not s.status & byte(s, UNLOADING_CONDITION):
        s.error_sum += error - s.drive_cut - s.integral_cut
    share = quotient(s.error_sum * gain, 500)
    bound = 4 * byte(s, INTEGRAL_LIMIT)
    kept = clip(share, bound) if bound else share
    s.integral_cut = share - kept
    return kept


@compiled
def velocity_loop(s: Record) -> int:
    """Return the drive computed from the speed error, which is in counts per window (section 4)."""
    error, gain = s.window_counts - profile_speed(s), byte(s, VELOCITY_I)
    s.error_sum = s.error_sum + error - s.drive_cut if gain else 0
    return limited(s, quotient(error * byte(s, VELOCITY_P), 10) + quotient(s.error_sum * gain, 1000))


@compiled
def asked_drive(s: Record) -> int:
    """Return the drive that the control loop of the operating mode requests."""
    mode = byte(s, OPERATING_MODE)
    if mode in (POSITION, STEP):
        return position_loop(s)
    if mode == VELOCITY:
        return velocity_loop(s)
    if mode == PWM:
        return clip(signed(s, GOAL_TIME, 10), word(s, TORQUE_LIMIT))
    return 0


@compiled
def rest_loops(s: Record) -> None:
    """Clear the state of the control loops while the torque is off."""
    s.error_then = s.error_change = s.error_sum = s.drive_cut = s.integral_cut = 0


# Protection (section 8).


@compiled
def watch_supply(s: Record) -> None:
    """Compare the voltage and temperature with their limits."""
    voltage, temperature = byte(s, PRESENT_VOLTAGE), byte(s, PRESENT_TEMPERATURE)
    s.high_voltage_ms = s.high_voltage_ms + 1 if voltage > byte(s, MAX_VOLTAGE) else 0
    s.hot_ms = s.hot_ms + 1 if temperature > byte(s, MAX_TEMPERATURE) else 0
    if voltage < byte(s, MIN_VOLTAGE) or s.high_voltage_ms >= HOLD_OFF_MS:
        s.status |= VOLTAGE
    elif voltage <= byte(s, MAX_VOLTAGE):
        s.status &= ~VOLTAGE
    if s.hot_ms >= HOLD_OFF_MS:
        s.status |= TEMPERATURE
    elif temperature < byte(s, MAX_TEMPERATURE) - COOL_DOWN_C:
        s.status &= ~TEMPERATURE


@compiled
def watch_current(s: Record) -> None:
    """Detect a current that is too high for too long. Switch the torque off if the unloading condition enables this."""
    limit, longest_ms = word(s, PROTECTION_CURRENT), 10 * byte(s, OVERCURRENT_TIME)
    watched = limit > 0 and longest_ms > 0
    over = watched and word(s, PRESENT_CURRENT) >= limit
    s.overcurrent_ms = s.overcurrent_ms + 1 if over else 0
    if s.overcurrent_ms > longest_ms:
        s.status |= CURRENT
    elif not watched or (not over and byte(s, TORQUE_ENABLE) == 1):
        s.status &= ~CURRENT
    if s.status & CURRENT & byte(s, UNLOADING_CONDITION):
        s.table[TORQUE_ENABLE] = 0


@compiled
def watch_push(s: Record, asked: int) -> None:
    """Detect an overload: a high drive that fails to move the shaft for too long."""
    if byte(s, TORQUE_ENABLE) != 1 or asked * s.push < 10 * byte(s, PROTECTIVE_TORQUE):
        s.push = 0
        s.status &= ~OVERLOAD
    elif not s.status & OVERLOAD and abs(s.window_position - s.push_position) > MOVED_COUNTS:
        s.push = 0
    if s.push == 0 and byte(s, TORQUE_ENABLE) == 1 and abs(asked) > 10 * byte(s, OVERLOAD_TORQUE):
        s.push = 1 if asked > 0 else -1
        s.push_ms, s.push_position = 0, s.window_position
    if s.push:
        s.push_ms += 1
        if s.push_ms > 10 * byte(s, PROTECTION_TIME):
            s.status |= OVERLOAD


@compiled
def protected(s: Record, asked: int) -> int:
    """During an overload, limit the requested drive to the protective torque."""
    if s.status & byte(s, UNLOADING_CONDITION) & OVERLOAD and byte(s, OPERATING_MODE) != PWM:
        asked = s.push * 10 * byte(s, PROTECTIVE_TORQUE)
    return asked


# Main loop (section 1).


@compiled
def tick(s: Record) -> None:
    """Run the firmware for one millisecond."""
    sense(s)
    take_writes(s)
    watch_supply(s)
    watch_current(s)
    on = byte(s, TORQUE_ENABLE) == 1
    unsupplied = s.status & byte(s, UNLOADING_CONDITION) & (VOLTAGE | TEMPERATURE)
    if not on or unsupplied or (byte(s, OPERATING_MODE) >= PWM and byte(s, OPERATING_MODE) != STEP):
        follow_shaft(s)
    elif byte(s, OPERATING_MODE) == VELOCITY:
        ramp_speed(s)
    else:
        advance_profile(s)
    if on:
        asked = asked_drive(s)
    else:
        rest_loops(s)
        asked = 0
    watch_push(s, asked)
    blind = s.status & byte(s, UNLOADING_CONDITION) & ENCODER
    s.drive = 0 if unsupplied or blind else protected(s, asked)
    if word(s, PROTECTION_CURRENT):  # Without a current limit, the reported drive exceeds that of the bridge.
        s.drive = clip(s.drive, BRIDGE_LIMIT)
    s.on = on
    report(s)


@compiled
def folded(s: Record, position: int) -> int:
    """Return a position as reported by the servo in all modes except step mode.

    The position is within one turn. If the unfolded bit of the phase register is set, the position is not wrapped, and
    its unit is the angular resolution.
    """
    return quotient(position, max(1, byte(s, ANGULAR_RESOLUTION))) if byte(s, PHASE) & UNFOLDED_BIT else position % TURN


@compiled
def steps(s: Record, counts: int) -> int:
    """Convert counts to step mode units, which depend on the angular resolution."""
    return clip(quotient(counts, max(1, byte(s, ANGULAR_RESOLUTION))), LARGEST_SHOWN)


@compiled
def report(s: Record) -> None:
    """Write the state to the control table (section 6)."""
    mode, speed_unit = byte(s, OPERATING_MODE), SPEED_UNIT if byte(s, PHASE) & COUNTS_PER_S_BIT else 1
    if mode == STEP:
        put_signed(s, PRESENT_POSITION, steps(s, s.goal - s.position), 15)
    else:
        put_signed(s, PRESENT_POSITION, folded(s, s.position if mode == POSITION else s.raw), 15)
    put_signed(s, PRESENT_VELOCITY, s.window_counts * speed_unit, 15)
    put_signed(s, PRESENT_LOAD, s.drive, 10)
    s.table[STATUS] = s.status
    if counts_turns(s):
        s.table[MOVING] = profile_runs(s) or (byte(s, MOVING) != 0 and s.window_counts != 0)
    else:
        s.table[MOVING] = s.window_counts != 0
    setpoint = quotient(s.setpoint_e4, FINE)
    put_signed(s, PRESENT_TARGET, steps(s, setpoint) if mode == STEP else folded(s, setpoint), 15)
    put_signed(s, TARGET_VELOCITY, profile_speed(s) * speed_unit, 15)


@compiled
def measure(s: Record, voltage_v: float) -> None:
    """Write the voltage, temperature and current to the control table, in the units of the servo's A/D converter."""
    s.table[PRESENT_VOLTAGE] = max(0, min(255, int(voltage_v * 10.0 + 0.5)))
    s.table[PRESENT_TEMPERATURE] = max(0, min(255, int(s.temperature_c + 0.5)))
    put_word(s, PRESENT_CURRENT, min(LARGEST_CURRENT, int(abs(s.current_a) / CURRENT_UNIT_A)))


@compiled
def power_on(states: States, voltage_v: float) -> None:
    """Load the settings that the firmware reads only at power-on, and read the encoder."""
    s: Record = states[0]
    s.windows_s = max(1, byte(s, VELOCITY_UNIT))
    s.window_ms = 1000 // s.windows_s
    s.lowest_counts_s, s.highest_counts_s = s.windows_s * byte(s, HTS), SPEED_UNIT * byte(s, MAX_VELOCITY)
    begin_profile(s)
    look(states, voltage_v)


@compiled
def look(states: States, voltage_v: float) -> None:
    """Read the encoder once, as if all filters had settled. If the torque is off, the count of turns restarts at 0."""
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
    """Return the torque on the shaft (N m) and the supply current (A). Braking returns no current (assumed)."""
    duty = 0.0
    s.current_a = 0.0
    if byte(s, TORQUE_ENABLE) == 1 or byte(s, TORQUE_ENABLE) == 2:
        duty = -0.001 * clip(s.drive, BRIDGE_LIMIT)
        s.current_a = (duty * voltage_v - s.back_emf_v_s * velocity_rad_s) / s.resistance_ohm
    loss_w = s.current_a * s.current_a * s.resistance_ohm
    warm_c = s.ambient_c + loss_w * s.thermal_resistance_k_w - s.temperature_c
    s.temperature_c += warm_c * dt_s / s.thermal_time_s
    return s.torque_constant_nm_a * s.current_a, max(0.0, duty * s.current_a)


@compiled
def step(states: States, dt_s: float, angle_rad: float, velocity_rad_s: float, voltage_v: float) -> tuple[float, float]:
    """Advance one servo by ``dt_s``. Return the torque (N m) and the supply current (A)."""
    return pass_time(states[0], dt_s, angle_rad, velocity_rad_s, voltage_v)


@compiled
def pass_time(s: Record, dt_s: float, angle_rad: float, velocity_rad_s: float, voltage_v: float) -> tuple[float, float]:
    """Advance one record by ``dt_s``. The result is the same as that of ``step``."""
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


# Several servos (section 10).


@compiled
def share_supplies(states: States, supplies: Supplies) -> None:
    """Compute the voltage of each supply from the total current of all servos on that supply."""
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
    """Advance all servos on a bus by ``dt_s``: read the joint positions and velocities, and write the joint efforts."""
    share_supplies(states, supplies)
    for i in range(len(states)):
        s: Record = states[i]
        shaft = shafts[i]
        angle_rad = position[shaft.position_at] * shaft.per_unit + shaft.zero_rad
        velocity_rad_s = velocity[shaft.velocity_at] * shaft.per_unit
        torque_nm, s.supply_current_a = pass_time(s, dt_s, angle_rad, velocity_rad_s, s.voltage_v)
        effort[shaft.effort_at] = torque_nm * shaft.per_unit
