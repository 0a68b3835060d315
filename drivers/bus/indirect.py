"""The servos' indirect registers are mapped when they are identified, and a map that was lost with the next torque-on.

Every reply proves its map (drivers/servos/indirect.py). A servo that does not prove it was reset: it has no torque, and
is asked for the direct block until it is given torque again.
"""

import logging
from functools import partial
from typing import Final

from drivers.bus.known_servos import KnownServos
from drivers.bus.retry import retry
from drivers.bus.single_servo import SingleServo
from drivers.errors import ServoError
from drivers.servos import x
from drivers.servos.indirect import MAP, MAP_REGISTER, block_for
from drivers.servos.register import Register, ServoModel
from drivers.servos.series import StateBlock

LOG = logging.getLogger("servoloop.drivers")

_MAP: Final = int.from_bytes(MAP, "little")


class IndirectMaps:
    """The maps of the servos on the line of this name."""

    def __init__(self, servos: KnownServos, single: SingleServo, name: str) -> None:
        self._servos = servos
        self._single = single
        self._name = name
        self._lost: set[int] = set()
        self._told: set[int] = set()

    def set_up(self, servo_id: int, model: ServoModel) -> None:
        """Map a servo that has just been identified; whose registers do not take it stays on the direct block.

        Raises only PortLost.
        """
        self._servos.unmap(servo_id)
        try:
            # Where the cells lie depends on the firmware in some models only.
            read_version = partial(self._single.read, servo_id, x.firmware_version)
            block = block_for(model, retry(read_version) if model in x.X330 else 0)
            why = self._map(servo_id, block) if block else ""
        except ServoError as error:
            why = error.text
        if why and servo_id not in self._told:
            self._told.add(servo_id)
            LOG.info(
                "%s: servo %d is read by the direct block: the map of its indirect registers was tried, and it %s",
                self._name, servo_id, why,
            )  # fmt: skip

    def _map(self, servo_id: int, block: StateBlock) -> str:
        """Write the map, read it back, and look whether the cells show it; what is wrong, if so."""
        retry(partial(self._single.write, servo_id, MAP_REGISTER, _MAP))
        if retry(partial(self._single.read, servo_id, MAP_REGISTER)) != _MAP:
            return "does not keep it"
        # One byte more than a group read asks for, so that a late answer is none to that.
        cells = Register("indirect data", block.address, block.size + 1)
        data = retry(partial(self._single.read, servo_id, cells)).to_bytes(cells.size, "little")
        if block.decode(None, 0, data[: block.size]) is None:
            return "does not show what it is to show"
        self._servos.map(servo_id, block)
        self._lost.discard(servo_id)
        return ""

    def lost(self, servo_id: int) -> None:
        """The servo has answered without proof of its map."""
        if servo_id in self._servos.mapped:
            LOG.warning(
                "%s: servo %d has lost the map of its indirect registers, so its memory: it was reset (by a dip of "
                "its supply?), and its torque went off. It is read by the direct block until it has torque again",
                self._name, servo_id,
            )  # fmt: skip
            self._lost.add(servo_id)
            self._servos.unmap(servo_id)

    def restore(self, servo_id: int) -> None:
        """Map a servo that has lost its map; raises only PortLost."""
        if servo_id in self._lost:
            self.set_up(servo_id, self._servos.model(servo_id))
