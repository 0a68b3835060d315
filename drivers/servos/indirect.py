"""The whole state of an X series servo in one piece, hardware error and current included: through indirect registers.

Indirect address n (two bytes each, from 168 on) says which byte of the RAM the data cell n shows. Cells side
by side are then one block. Source: ROBOTIS e-manual, "Indirect Address, Indirect Data" of the models' pages;
the places of the cells agree with the model files of ROBOTIS' SDK (``xl330_m288.model``, ``..._fw52.model``):
- XL330 and XC330 "prior to V53" have 20 cells from 208 on and may show 64 to 227, later firmware 28 from 224 on
  and 64 to 251; the others have 28 cells from 224 on (and more elsewhere) and may show 64 to 661;
- they are RAM: power-off and reboot forget them, and each cell is then its own byte again, 0. Torque locks
  the EEPROM only (page text of Torque Enable), so they can be written while the motor holds.

A map that is forgotten must never be taken for a state. So the first and the last cell show a byte that
only the written map holds: the low bytes of their own indirect addresses. The map is thereby in every reply.
Forgotten, both are 0. Whoever changes the block must change its size, or else the last proof does not move.
"""

from itertools import chain
from struct import Struct, pack
from typing import Final

from drivers.bus.types import ServoState
from drivers.servos import x
from drivers.servos.dynamixel import alarmed, x_state
from drivers.servos.register import Register, ServoModel
from drivers.servos.series import StateBlock

POINTERS: Final = 168
"""Where indirect address 1 stands."""
LAST_OLD_X330: Final = 52
"""The last firmware version of XL330 and XC330 with their cells at 208."""

_SHOWN: Final = (
    x.hardware_error_status,
    x.present_pwm,
    x.present_current,  # or load, as the model is; ServoState's load is the PWM in all models
    x.present_velocity,
    x.present_position,
    x.present_voltage,
    x.present_temperature,
)
_FIELDS: Final = Struct("<BBhhiiHBB")
_SIZE: Final = _FIELDS.size
_FIRST_PROOF: Final = POINTERS
_LAST_PROOF: Final = POINTERS + 2 * (_SIZE - 1)
_PLACES: Final = (_FIRST_PROOF, *chain.from_iterable(range(r.address, r.address + r.size) for r in _SHOWN), _LAST_PROOF)

MAP: Final = pack(f"<{_SIZE}H", *_PLACES)
"""The indirect addresses 1 to 18."""
MAP_REGISTER: Final = Register("indirect addresses", POINTERS, len(MAP))
"""All of them as one number: they are written and read back in one piece."""

_ALARMS: Final = tuple(map(x.alarms, range(256)))


def _state(
    unit_a: float | None, error: int, _first: int, hardware_error: int,
    pwm: int, current: int, velocity: int, position: int, voltage: int, temperature: int, _last: int,
) -> ServoState:  # fmt: skip
    alarms = _ALARMS[hardware_error] if hardware_error else alarmed(error)
    return x_state(unit_a, alarms, pwm, current, velocity, position, voltage, temperature)


def _block(address: int) -> StateBlock:
    proof = (_FIRST_PROOF & 0xFF, _LAST_PROOF & 0xFF)
    return StateBlock(address, _SIZE, _FIELDS, 0, _state, fast=True, proof=proof)


AT_208: Final = _block(208)
AT_224: Final = _block(224)


def block_for(model: ServoModel, firmware: int) -> StateBlock | None:
    """Where a servo with this firmware version has the cells; None for a model without indirect registers."""
    if model not in x.MODELS.values():
        return None
    return AT_208 if model in x.X330 and firmware <= LAST_OLD_X330 else AT_224
