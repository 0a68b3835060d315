"""Read the whole state of an X series servo, including hardware error and current, through indirect registers.

Indirect address n selects the byte of RAM that data cell n shows. Each address takes two bytes, from 168 on. Adjacent
cells form one block. Source: ROBOTIS e-manual, "Indirect Address, Indirect Data" on the pages of the models. The
addresses agree with the model files of ROBOTIS' SDK (``xl330_m288.model``, ``..._fw52.model``):

- XL330 and XC330 "prior to V53" have 20 cells from 208 on for bytes 64 to 227. Later firmware has 28 cells from 224 on
  for bytes 64 to 251. The other models have 28 cells from 224 on, and more cells at other addresses, for bytes
  64 to 661.
- Indirect registers are in RAM. After power-off or a reboot, each cell is an ordinary byte with the value 0. Torque
  locks only the EEPROM (page text of Torque Enable), so the indirect registers can be written while torque is enabled.

Cells without a map must never be mistaken for a state. The first and the last cell therefore show a byte of the map
itself: the low bytes of their own indirect addresses. These bytes are 0 without a map, so every reply proves that the
map is intact. If you change the block, change its size as well. Otherwise the last cell keeps its value and proves
nothing.
"""

from itertools import chain
from struct import Struct, pack
from typing import Final

from drivers.servos import x
from drivers.servos.dynamixel import x_state
from drivers.servos.register import Register, ServoModel
from drivers.servos.series import StateBlock

POINTERS: Final = 168
"""Address of indirect address 1."""
LAST_OLD_X330: Final = 52
"""Last firmware version of XL330 and XC330 that has the cells at 208."""

_SHOWN: Final = (
    x.hardware_error_status,
    x.present_pwm,
    x.present_current,  # or load, depending on the model; the load of ServoState is the PWM for all models
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
"""Values of the indirect addresses 1 to 18."""
MAP_REGISTER: Final = Register("indirect addresses", POINTERS, len(MAP))
"""All indirect addresses as one register, which is written and read back in one piece."""


def _block(address: int) -> StateBlock:
    proof = (_FIRST_PROOF & 0xFF, _LAST_PROOF & 0xFF)
    return StateBlock(address, _SIZE, _FIELDS, 0, x_state, fast=True, proof=proof)


AT_208: Final = _block(208)
AT_224: Final = _block(224)


def block_for(model: ServoModel, firmware: int) -> StateBlock | None:
    """Return the block of cells for a model and firmware version, or None if the model has no indirect registers."""
    if not isinstance(model, x.XModel):
        return None
    return AT_208 if model.short_map and firmware <= LAST_OLD_X330 else AT_224
