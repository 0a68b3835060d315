"""State of one virtual STS servo, as one record that compiled code can process.

The first field is the control table. The firmware reads its settings from this table and writes its state to it.
"""

from typing import Final

import numpy as np
from numpy.typing import NDArray

TABLE_SIZE: Final = 87

States = NDArray[np.void]
"""An array with one record for each servo."""

Supplies = NDArray[np.void]
"""An array with one ``SUPPLY`` record for each supply of a bus."""

_PARAMETERS: Final = (
    # Motor, as seen at the output shaft.
    ("torque_constant_nm_a", "f8"),
    ("back_emf_v_s", "f8"),
    ("resistance_ohm", "f8"),
    ("thermal_resistance_k_w", "f8"),
    ("thermal_time_s", "f8"),
    ("ambient_c", "f8"),
    ("encoder_lag_s", "f8"),
    # Behavior for which reports about the firmware contradict each other.
    ("goal_write_energises", "i8"),
    ("torque_on_takes_goal", "i8"),
    # Physical state, which is not lost at power-off.
    ("temperature_c", "f8"),
    ("lagged_rad", "f8"),  # shaft angle after the encoder filter
    ("encoder_fails", "i8"),  # whether the encoder does not respond to the firmware
    ("encoder_sticks", "i8"),  # whether the encoder repeats its last value
    ("deaf_s", "f8"),  # remaining time of a reboot
    ("supply", "i8"),  # index of the supply that feeds the servo
    ("voltage_v", "f8"),
    ("supply_current_a", "f8"),  # current that the motor draws from the supply
)

_VOLATILE: Final = (
    ("elapsed_ns", "i8"),  # time since the last full millisecond
    ("noted", "i8"),  # goals and profile settings changed by the last write
    # Settings that are read only at power-on.
    ("windows_s", "i8"),  # windows per second; this is also the speed of one count per window, in counts per second
    ("window_ms", "i8"),
    ("lowest_counts_s", "i8"),
    ("highest_counts_s", "i8"),
    # Sensing (section 6). The position ``position`` continues beyond one turn.
    ("recount", "i8"),  # whether to restart the count of turns
    ("mode", "i8"),
    ("offset", "i8"),
    ("raw", "i8"),
    ("reading", "i8"),
    ("turns", "i8"),
    ("position", "i8"),
    ("window_age_ms", "i8"),
    ("window_position", "i8"),
    ("window_counts", "i8"),
    # Motion profile (section 5), in counts, 1/10000 count, and 1/10000 count per ms.
    ("on", "i8"),
    ("goal", "i8"),
    ("setpoint_e4", "i8"),
    ("speed_e4", "i8"),
    ("top_e4", "i8"),  # speed requested by the last write of the goal velocity
    ("ramp_e4", "i8"),  # change of speed per ms allowed by the last write of the acceleration
    ("planned", "i8"),  # whether the set-point can stop at the goal
    # Control loops (sections 3 and 4).
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
    ("push", "i8"),  # direction of the drive that is checked for overload; 0 for none
    ("push_ms", "i8"),
    ("push_position", "i8"),
    # Motor (sections 2 and 10).
    ("current_a", "f8"),
)

STATE: Final = np.dtype([("table", "u1", (TABLE_SIZE,)), *_PARAMETERS, *_VOLATILE], align=True)


SUPPLY: Final = np.dtype([("voltage_v", "f8"), ("resistance_ohm", "f8"), ("left_v", "f8")])
"""A power supply, and its voltage under load."""


def new_states(**parameters: float) -> States:
    """Return the record of one servo with these parameters. All other fields are 0."""
    states = np.zeros(1, STATE)
    for name, value in parameters.items():
        states[name] = value
    return states


def forget_volatile(states: States) -> None:
    """Reset all fields that are lost at power-off, except for the control table."""
    for name, _ in _VOLATILE:
        states[name] = 0
