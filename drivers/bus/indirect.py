"""The servos' indirect registers are kept mapped: at set-up, and again when a servo has lost its memory.

Every reply proves its map (drivers/servos/indirect.py). A servo that does not prove it, or does not answer, is asked
for the direct block from then on and mapped anew, by one transaction a cycle where there is time: the map is
written, read back, and then the cells are read. Only what they show is trusted.
"""

import logging
from collections.abc import Collection, Mapping
from dataclasses import dataclass
from functools import partial
from typing import Final

from drivers.bus.adaptive_timeout import FIRST_REPLY_S
from drivers.bus.known_servos import KnownServos
from drivers.bus.retry import retry
from drivers.bus.single_servo import SingleServo
from drivers.bus.types import Reading, ServoState
from drivers.errors import ServoError
from drivers.port.line import Line
from drivers.protocol import v2
from drivers.servos import x
from drivers.servos.indirect import MAP, MAP_REGISTER, block_for
from drivers.servos.register import Register, ServoModel
from drivers.servos.series import StateBlock

LOG = logging.getLogger("servoloop.drivers")

PAUSE_S: Final = 0.25
LONGEST_PAUSE_S: Final = 10.0
"""Until the map of a servo is written again. It doubles with every loss of it and every try in vain, so that one
whose map never holds costs little."""
STEPS: Final = 3
"""Transactions that map a servo."""
MISSES: Final = 5
"""After so many questions in a row without a state the map is doubted: the servo may be another one now."""
TRANSACTION_SIZE: Final = len(MAP) + 2 * v2.OVERHEAD + 4
"""Bytes of a write or a read of the map, reply included."""

_TRIED: Final = "the map of its indirect registers was tried, and it"
_MAP: Final = int.from_bytes(MAP, "little")


@dataclass(slots=True)
class _Wanted:
    """A servo that is to have its map again, from when on, and how many of the steps to it are done."""

    block: StateBlock
    next_s: float
    done: int = 0


class IndirectMaps:
    """The maps of the servos on one line."""

    def __init__(self, servos: KnownServos, single: SingleServo, line: Line) -> None:
        self._servos = servos
        self._single = single
        self._line = line
        self._wanted: dict[int, _Wanted] = {}
        self._misses: dict[int, int] = {}
        self._vain: dict[int, int] = {}
        self._told: set[int] = set()

    def set_up(self, servo_id: int, model: ServoModel) -> None:
        """Map a servo that has just been identified; whose registers do not take it stays on the direct block.

        Raises only PortLost.
        """
        self._servos.unmap(servo_id)
        for kept in (self._wanted, self._misses, self._vain):
            kept.pop(servo_id, None)
        try:
            why = self._map(servo_id, model)
        except ServoError as error:
            why = error.text
        if why and servo_id not in self._told:
            self._told.add(servo_id)
            LOG.info("%s: servo %d is read by the direct block: %s %s", self._line.port.name, servo_id, _TRIED, why)

    def _map(self, servo_id: int, model: ServoModel) -> str:
        """Write the map, read it back, and look whether the cells show it; what is wrong, if so."""
        # Where the cells lie depends on the firmware in some models only.
        read_version = partial(self._single.read, servo_id, x.firmware_version)
        firmware = retry(read_version) if model in x.X330 else 0
        block = block_for(model, firmware)
        if block is None:
            return ""
        for step in range(STEPS):
            if why := retry(partial(self._step, servo_id, block, step)):
                return why
        self._servos.map(servo_id, block)
        return ""

    def _step(self, servo_id: int, block: StateBlock, step: int) -> str:
        """One of the transactions that map a servo; what is wrong, if so."""
        if step == 0:
            self._single.write(servo_id, MAP_REGISTER, _MAP)
            return ""
        if step == 1:
            return "" if self._single.read(servo_id, MAP_REGISTER) == _MAP else "does not keep it"
        # One byte more than a group read asks for, so that a late answer is none to that.
        cells = Register("indirect data", block.address, block.size + 1)
        data = self._single.read(servo_id, cells).to_bytes(cells.size, "little")
        return "" if block.decode(None, 0, data[: block.size]) else "does not show what it is to show"

    def lost(self, servo_id: int) -> None:
        """The servo has answered without proof of its map."""
        if self._servos.is_mapped(servo_id):
            LOG.warning(
                "%s: servo %d has lost the map of its indirect registers, so its memory: it was reset (by a dip of "
                "its supply?), and its torque went off. It is read by the direct block until it is mapped again",
                self._line.port.name,
                servo_id,
            )
            self._doubt(servo_id)

    def _doubt(self, servo_id: int) -> None:
        """By the direct block, and mapped again after a while."""
        block = self._servos.blocks(servo_id)[0]
        self._servos.unmap(servo_id)
        self._misses.pop(servo_id, None)
        self._want(servo_id, block)

    def _want(self, servo_id: int, block: StateBlock) -> None:
        vain = self._vain.get(servo_id, 0)
        self._vain[servo_id] = vain + 1
        self._wanted[servo_id] = _Wanted(block, self._line.now() + min(PAUSE_S * 2.0**vain, LONGEST_PAUSE_S))

    def watch(self, blocks: Mapping[int, StateBlock], missing: Collection[int]) -> None:
        """Count who was asked for the mapped block in one cycle without giving a state at once."""
        for servo_id, block in blocks.items():
            if block.proof and servo_id not in missing:
                self._misses.pop(servo_id, None)
            elif block.proof and self._servos.is_mapped(servo_id):
                self._misses[servo_id] = self._misses.get(servo_id, 0) + 1
                if self._misses[servo_id] >= MISSES:
                    self._doubt(servo_id)

    def tend(self, readings: Mapping[int, Reading], deadline_s: float) -> None:
        """One transaction for one servo that has just answered and wants its map, if it is due and there is time."""
        now_s = self._line.now()
        servo_id = next(
            (i for i, w in self._wanted.items() if w.next_s <= now_s and isinstance(readings.get(i), ServoState)), None
        )
        needed_s = TRANSACTION_SIZE * self._line.byte_s + FIRST_REPLY_S / 4.0
        if servo_id is None or now_s + needed_s >= deadline_s:
            return
        self._go_on(servo_id, self._wanted[servo_id], deadline_s)

    def _go_on(self, servo_id: int, wanted: _Wanted, deadline_s: float) -> None:
        """The next step to the map."""
        try:
            with self._single.until(servo_id, deadline_s):
                why = self._step(servo_id, wanted.block, wanted.done)
        except ServoError as error:
            why = error.text
        if why:
            LOG.debug("%s: servo %d is not mapped again yet: %s %s", self._line.port.name, servo_id, _TRIED, why)
            self._want(servo_id, wanted.block)
            return
        wanted.done += 1
        if wanted.done == STEPS:
            del self._wanted[servo_id]
            self._servos.map(servo_id, wanted.block)
            LOG.info("%s: servo %d is mapped again", self._line.port.name, servo_id)

    @property
    def busy(self) -> bool:
        """Whether anybody wants a map or is being watched."""
        return bool(self._wanted or self._misses)
