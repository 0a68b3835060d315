"""Map the indirect registers of servos when they are identified, and restore lost maps before torque is enabled.

Every valid reply proves that the map is intact (drivers/servos/indirect.py). A reply without this proof shows that the
servo was reset and that its torque is disabled. The state of this servo is then read from the direct block until its
torque is enabled again.
"""

import logging
from functools import partial
from typing import Final

from drivers.bus.known_servos import KnownServos
from drivers.bus.retry import retry
from drivers.bus.single_servo import SingleServo
from drivers.driver_errors import ServoError
from drivers.servos import x
from drivers.servos.indirect import MAP, MAP_REGISTER, block_for
from drivers.servos.register import Register, ServoModel
from drivers.servos.series import StateBlock

LOG = logging.getLogger("servoloop.drivers")

_MAP: Final = int.from_bytes(MAP, "little")


class IndirectMaps:
    """Indirect register maps of the servos on one bus."""

    def __init__(self, servos: KnownServos, single: SingleServo, name: str) -> None:
        self._servos = servos
        self._single = single
        self._name = name
        self._lost: set[int] = set()
        self._reported: set[int] = set()

    def set_up(self, servo_id: int, model: ServoModel) -> None:
        """Map the indirect registers of an identified servo. If a ServoError occurs, the direct block stays in use."""
        self._servos.unmap(servo_id)
        try:
            block = None
            if isinstance(model, x.XModel):
                version = retry(partial(self._single.read, servo_id, x.firmware_version))
                self._servos.set_firmware(servo_id, version)
                block = block_for(model, version)
            why = self._map(servo_id, block) if block else ""
        except ServoError as error:
            why = error.text
        if why and servo_id not in self._reported:
            self._reported.add(servo_id)
            LOG.info(
                "%s: servo %d is read from the direct block, because after its indirect registers were mapped, it %s",
                self._name, servo_id, why,
            )  # fmt: skip

    def _map(self, servo_id: int, block: StateBlock) -> str:
        """Write the map, read it back and check the mapped data registers.

        Return None, or a description of the problem, worded to follow "it".
        """
        retry(partial(self._single.write, servo_id, MAP_REGISTER, _MAP))
        if retry(partial(self._single.read, servo_id, MAP_REGISTER)) != _MAP:
            return "did not keep the map"
        # This read is one byte longer than a group read, so that its late reply cannot be mistaken for a group read
        # reply.
        cells = Register("indirect data", block.address, block.size + 1)
        data = retry(partial(self._single.read, servo_id, cells)).to_bytes(cells.size, "little")
        if block.decode(None, 0, data[: block.size]) is None:
            return "did not return the mapped registers"
        self._servos.map(servo_id, block)
        self._lost.discard(servo_id)
        return ""

    def mark_lost(self, servo_id: int) -> None:
        """Record that the servo has replied without proof of its map."""
        if servo_id in self._servos.mapped:
            LOG.warning(
                "%s: servo %d has lost the mapping of its indirect registers: it was reset, perhaps by a voltage drop, "
                "and its torque is disabled. It is read from the direct block until its torque is enabled again",
                self._name, servo_id,
            )  # fmt: skip
            self._lost.add(servo_id)
            self._servos.unmap(servo_id)

    def restore(self, servo_id: int) -> None:
        """Map the indirect registers again if the servo has lost its map."""
        if servo_id in self._lost:
            self.set_up(servo_id, self._servos.model(servo_id))
