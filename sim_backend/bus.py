"""Virtual Feetech servos on one wire: bytes and a time in, bytes and their arrival out.

From the protocol manual: no reply to a broadcast; a sync read is answered in the order in which
it names the servos. Assumed: the turns of a sync read are slots, so a silent servo leaves a gap as
long as its reply would have been, and those after it answer all the same; a broadcast ping, which
the manual advises against, is answered one after the other by rising ID (clients in use rely on
that).
"""

from collections.abc import Sequence

from drivers.feetech import sts
from drivers.registers import ServoModel
from sim_backend.line import Reply, ServoLine, Turn, named
from sim_backend.plant import Plant
from sim_backend.rig import Rig, Supply
from sim_backend.servo import VirtualServo
from sim_backend.sts_wire import BROADCAST, STATUS_OVERHEAD, Code, Instruction, InstructionParser

__all__ = ["Reply", "VirtualBus"]

_ID_AT = 2


class VirtualBus(ServoLine[VirtualServo]):
    """A line of STS servos. Times are the caller's clock; the rig's time begins with the first call."""

    def __init__(self, rig: Rig[VirtualServo], *, paced: bool = True) -> None:
        """``paced`` bytes take their time on the wire; unpaced ones none (to measure software)."""
        super().__init__(rig, InstructionParser(), _ID_AT, paced=paced)

    @classmethod
    def of(
        cls,
        plant: Plant,
        model: ServoModel = sts.STS3215,
        *,
        supply: Supply | None = None,
        paced: bool = True,
    ) -> "VirtualBus":
        """A bus with one new servo of ``model`` for each coupling of ``plant``."""
        servos = [VirtualServo(model, coupling.servo_id) for coupling in plant.couplings]
        return cls(Rig(servos, plant, supply), paced=paced)

    def _obey(
        self, instruction: Instruction, at_s: float, byte_s: float, servos: Sequence[VirtualServo]
    ) -> list[Reply]:
        """Let ``servos`` do one instruction; whatever comes back, in order."""
        parameters = instruction.parameters
        if instruction.code == Code.SYNC_WRITE:
            _sync_write(parameters, servos)
            return []
        if instruction.code == Code.SYNC_READ:
            slot_s = (STATUS_OVERHEAD + sum(parameters[1:2])) * byte_s
            return self._in_turn(_sync_read(parameters, servos), at_s, byte_s, slot_s)
        broadcast = instruction.servo_id == BROADCAST
        turns = self._answers(instruction, servos if broadcast else named(instruction.servo_id, servos))
        if broadcast and instruction.code != Code.PING:
            return []
        return self._in_turn(turns, at_s, byte_s, 0.0)


def _sync_read(parameters: bytes, servos: Sequence[VirtualServo]) -> list[Turn]:
    """Address, size, and then the IDs: a turn for each of them, whether anybody is there or not."""
    turns = []
    for servo_id in parameters[2:]:
        asked = named(servo_id, servos)
        delay_s = max((servo.return_delay_s for servo in asked), default=0.0)
        turns.append((delay_s, [servo.read_status(*parameters[:2]) for servo in asked]))
    return turns


def _sync_write(parameters: bytes, servos: Sequence[VirtualServo]) -> None:
    """Address, size, and then an ID and ``size`` bytes for each servo; half an entry is ignored."""
    if len(parameters) < 2:
        return
    address, size = parameters[:2]
    for at in range(2, len(parameters) - size, size + 1):
        for servo in named(parameters[at], servos):
            servo.write(address, parameters[at + 1 : at + 1 + size])
