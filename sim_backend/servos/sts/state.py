"""Everything that one virtual STS servo knows, as one record that compiled code can work on.

The first field is the control table itself: the firmware reads its settings from there and shows its state there.
"""

from typing import Final

import numpy as np
from numpy.typing import NDArray

TABLE_SIZE: Final = 87

States = NDArray[np.void]
"""An array with one record, or with one for each of several servos."""

Supplies = NDArray[np.void]
"""An array with a record of ``SUPPLY`` for each supply of a line."""

_PARAMETERS: Final = (
    # The motor at the output shaft.
    ("torque_constant_nm_a", "f8"),
    ("back_emf_v_s", "f8"),
    ("resistance_ohm", "f8"),
    ("thermal_resistance_k_w", "f8"),
    ("thermal_time_s", "f8"),
    ("ambient_c", "f8"),
    ("encoder_lag_s", "f8"),
    # How this firmware behaves where reports contradict each other.
    ("goal_write_energises", "i8"),
    ("torque_on_takes_goal", "i8"),
    # The world: what power-off does not change.
    ("temperature_c", "f8"),
    ("lagged_rad", "f8"),  # the shaft's angle, as the encoder has it by now
    ("encoder_fails", "i8"),  # it does not answer the firmware
    ("encoder_sticks", "i8"),  # it goes on saying what it said last
    ("deaf_s", "f8"),  # until it has rebooted
    ("supply", "i8"),  # which of the line's supplies feeds it
    ("voltage_v", "f8"),
    ("supply_current_a", "f8"),  # what the motor takes from the supply
)

_VOLATILE: Final = (
    ("elapsed_ns", "i8"),  # since the last millisecond
    ("noted", "i8"),  # which goals and settings of the profile the last write touched
    # Settings that are looked at when power comes on, and never again.
    ("windows_s", "i8"),  # how many a second; a count in one window is that many counts per second
    ("window_ms", "i8"),
    ("lowest_counts_s", "i8"),
    ("highest_counts_s", "i8"),
    # What it sees (section 6). ``position`` goes on beyond a turn.
    ("recount", "i8"),  # begin to count turns anew
    ("mode", "i8"),
    ("offset", "i8"),
    ("raw", "i8"),
    ("reading", "i8"),
    ("turns", "i8"),
    ("position", "i8"),
    ("window_age_ms", "i8"),
    ("window_position", "i8"),
    ("window_counts", "i8"),
    # The profile (section 5): counts, 1/10000 count, 1/10000 count per ms.
    ("on", "i8"),
    ("goal", "i8"),
    ("setpoint_e4", "i8"),
    ("speed_e4", "i8"),
    ("top_e4", "i8"),  # what 46 asked for when it was written last
    ("ramp_e4", "i8"),  # the change of speed in a ms that 41 allowed when it was written last
    ("planned", "i8"),  # the goal can be met as things are
    # The loops (sections 3 and 4).
    ("error_age_ms", "i8"),
    ("error_then", "i8"),
    ("error_change", "i8"),
    ("error_sum", "i8"),
    ("drive_cut", "i8"),
    ("integral_cut", "i8"),
    ("drive", "i8"),
    # Protection (section 8).
    ("status", "i8"),
    ("high_voltage_ms", "i8"),
    ("hot_ms", "i8"),
    ("overcurrent_ms", "i8"),
    ("push", "i8"),  # the direction of a drive that is watched, 0 if none is
    ("push_ms", "i8"),
    ("push_position", "i8"),
    # The motor (sections 2 and 10).
    ("current_a", "f8"),
)

STATE: Final = np.dtype([("table", "u1", (TABLE_SIZE,)), *_PARAMETERS, *_VOLATILE], align=True)


SUPPLY: Final = np.dtype([("voltage_v", "f8"), ("resistance_ohm", "f8"), ("left_v", "f8")])
"""A power supply, and the voltage that it has left under its load."""


def new_states(**parameters: float) -> States:
    """One servo's record; all that is not named is 0."""
    states = np.zeros(1, STATE)
    for name, value in parameters.items():
        states[name] = value
    return states


def forget_volatile(states: States) -> None:
    """Put everything to 0 that power-off takes away, but for the table."""
    for name, _ in _VOLATILE:
        states[name] = 0
