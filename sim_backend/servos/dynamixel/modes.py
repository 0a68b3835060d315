"""Operating modes of the X series, and the values that are reset when the mode changes.

From the e-manual: when the mode changes, the gains, feedforward and profile are reset, ``goal_pwm`` is set to the PWM
limit, and ``goal_current`` is set to the current limit. Assumed:
- The gains are reset to the factory values in every mode.
- In PWM, current and velocity mode, the goal drives the motor and is not a limit. This goal is 0 until a client writes
  it.
- The goal position is reset to the present position.
"""

from collections.abc import Mapping
from typing import Final

from drivers.servos import x
from drivers.servos.register import Register
from sim_backend.servos.generic.firmware import FirmwareMemory

CURRENT: Final = 0
VELOCITY: Final = 1
CURRENT_POSITION: Final = x.CURRENT_POSITION_MODE
PWM: Final = 16

MODE_GOALS: Final = {CURRENT: x.goal_current, VELOCITY: x.goal_velocity, PWM: x.goal_pwm}
"""Register of the goal, keyed by operating mode. In all other modes, the goal register is the goal position."""
POSITION_MODES: Final = (x.POSITION_MODE, x.EXTENDED_POSITION_MODE, CURRENT_POSITION)

GAINS: Final = (
    x.velocity_i_gain,
    x.velocity_p_gain,
    x.position_d_gain,
    x.position_i_gain,
    x.position_p_gain,
    x.feedforward_2nd_gain,
    x.feedforward_1st_gain,
)


def reset_goals(memory: FirmwareMemory, *, measures_current: bool) -> None:
    """Write the goals that a servo has after power-on and after a mode change, except for the goal position."""
    mode, get = memory.get(x.operating_mode), memory.get
    memory.put(x.goal_pwm, 0 if mode == PWM else get(x.pwm_limit))
    memory.put(x.goal_velocity, 0 if mode == VELOCITY else get(x.velocity_limit))
    if measures_current:
        memory.put(x.goal_current, 0 if mode == CURRENT else get(x.current_limit))


def reset_gains(memory: FirmwareMemory, factory: Mapping[Register, int]) -> None:
    """Write the gains and the profile that a servo has after a mode change."""
    for register in (*GAINS, x.profile_acceleration, x.profile_velocity):
        memory.put(register, factory.get(register, 0))
