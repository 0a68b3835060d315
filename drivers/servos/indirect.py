"""Read the whole state of an X-series servo, including hardware error and current, through indirect registers.

Indirect address n selects the RAM byte that indirect data register n shows. Each indirect address takes two bytes,
starting at 168. Adjacent data registers form one block. Source: ROBOTIS e-manual, "Indirect Address, Indirect Data" on
the models' pages. The addresses agree with the model files in ROBOTIS' SDK (``xl330_m288.model``, ``..._fw52.model``):

- XL330 and XC330 "prior to V53" have 20 data registers starting at 208, for bytes 64 to 227. Later firmware has 28 data
  registers starting at 224, for bytes 64 to 251. The other models have 28 data registers starting at 224, and more at
  other addresses, for bytes 64 to 661.
- Indirect registers are in RAM. After power-off or a reboot, each indirect data register is an ordinary byte with the
  value 0. Enabled torque locks only the EEPROM (see Torque Enable in the e-manual), so the indirect registers can be
  written while torque is enabled.

Unmapped data registers must never be mistaken for a state. The first and last data registers therefore each show a byte
of the map itself: the low bytes of their own indirect addresses. These bytes are 0 if there is no map, so every reply
proves that the map is intact. If you change the block, change its size as well. Otherwise, the last data register keeps
its value and proves nothing.
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
"""Last firmware version of XL330 and XC330 whose indirect data registers start at 208."""

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
"""All indirect addresses as a single register, which is written and read back in a single operation."""


def _block(address: int) -> StateBlock:
    proof = (_FIRST_PROOF & 0xFF, _LAST_PROOF & 0xFF)
    return StateBlock(address, _SIZE, _FIELDS, 0, x_state, fast=True, proof=proof)


AT_208: Final = _block(208)
AT_224: Final = _block(224)


def block_for(model: ServoModel, firmware: int) -> StateBlock | None:
    """Return the indirect data block for a model and firmware version, or None if the model has no indirect
    registers."""
    if not isinstance(model, x.XModel):
        return None
    return AT_208 if model.short_map and firmware <= LAST_OLD_X330 else AT_224
