"""Virtual servos on one wire, Feetech's and Dynamixels of protocol 1.0: bytes and a time in, bytes and times out.

From the protocol manuals: no reply to a broadcast; a sync read and a bulk read are answered in the
order in which they name the servos, and in a bulk read each waits for the reply before its own: one
that is silent hides those after it. Assumed: the turns of a sync read are slots, so a silent servo leaves a gap as
long as its reply would have been, and those after it answer all the same; a broadcast ping, which
the manual advises against, is answered one after the other by rising ID (clients in use rely on
that).
"""

from collections.abc import Mapping, Sequence

from drivers.servos import ax_mx as dynamixel1
from drivers.servos import sts
from drivers.servos.catalog import series_of
from drivers.servos.register import ServoModel
from sim_backend.dynamixel1_servo import VirtualAxServo, VirtualMxServo
from sim_backend.instructions import Instruction
from sim_backend.line import Reply, ServoLine, Turn, named
from sim_backend.plant import Plant
from sim_backend.rig import Rig, Supply
from sim_backend.scs_servo import VirtualScsServo
from sim_backend.servo import VirtualServo
from sim_backend.sts_wire import BROADCAST, STATUS_OVERHEAD, Code, InstructionParser

__all__ = ["Reply", "VirtualBus"]

_ID_AT = 2


class VirtualBus(ServoLine[VirtualServo]):
    """A line of servos with one kind of packet. Times are the caller's clock; the rig's begins with the first call."""

    def __init__(self, rig: Rig[VirtualServo], *, paced: bool = True) -> None:
        """``paced`` bytes take their time on the wire; unpaced ones none (to measure software)."""
        super().__init__(rig, InstructionParser(), _ID_AT, paced=paced)

    @classmethod
    def of(
        cls,
        plant: Plant,
        model: ServoModel | Mapping[int, ServoModel] = sts.STS3215,
        *,
        supply: Supply | None = None,
        paced: bool = True,
    ) -> "VirtualBus":
        """A bus with one new servo for each coupling of ``plant``; ``model``: of all, or by ID.

        All are set up to 1 Mbit/s and no return delay. Without ``supply``, one of 12 V feeds STS servos and one of
        the lowest rated voltage the others.
        """
        models = {c.servo_id: model if isinstance(model, ServoModel) else model[c.servo_id] for c in plant.couplings}
        servos = [servo_of(own, servo_id) for servo_id, own in models.items()]
        return cls(Rig(servos, plant, supply or _supply(servos)), paced=paced)

    def _obey(
        self, instruction: Instruction, at_s: float, byte_s: float, servos: Sequence[VirtualServo]
    ) -> list[Reply]:
        """Let ``servos`` do one instruction; whatever comes back, in order."""
        parameters = instruction.parameters
        if instruction.code == Code.SYNC_WRITE:
            _sync_write(parameters, servos)
            return []
        if instruction.code == Code.SYNC_READ:
            knowing = [servo for servo in servos if servo.GROUP_READ == Code.SYNC_READ]
            slot_s = (STATUS_OVERHEAD + sum(parameters[1:2])) * byte_s
            return self._in_turn(_sync_read(parameters, knowing) if knowing else [], at_s, byte_s, slot_s)
        if instruction.code == Code.BULK_READ:
            knowing = [servo for servo in servos if servo.GROUP_READ == Code.BULK_READ]
            return self._in_turn(_bulk_read(parameters, knowing), at_s, byte_s, 0.0)
        broadcast = instruction.servo_id == BROADCAST
        turns = self._answers(instruction, servos if broadcast else named(instruction.servo_id, servos))
        if broadcast and instruction.code != Code.PING:
            return []
        return self._in_turn(turns, at_s, byte_s, 0.0)


def servo_of(model: ServoModel, servo_id: int) -> VirtualServo:
    """A new servo of ``model``, with the table and the habits of its series."""
    if isinstance(model, dynamixel1.Model):
        servo = (VirtualMxServo if model.bulk_read else VirtualAxServo)(model, servo_id)
        servo.memory.put(dynamixel1.baud_rate, 1)
        servo.memory.put(dynamixel1.return_delay, 0)
        return servo
    alone = series_of(model).make == "feetech" and series_of(model).protocol.group_read == "none"
    return (VirtualScsServo if alone else VirtualServo)(model, servo_id)


def _supply(servos: Sequence[VirtualServo]) -> Supply:
    """What servos of these kinds are fed with."""
    others = [servo.model.rated_voltage_v for servo in servos if type(servo) is not VirtualServo]
    return Supply(min(others)) if others else Supply()


def _sync_read(parameters: bytes, servos: Sequence[VirtualServo]) -> list[Turn]:
    """Address, size, and then the IDs: a turn for each of them, whether anybody is there or not."""
    turns = []
    for servo_id in parameters[2:]:
        asked = named(servo_id, servos)
        delay_s = max((servo.return_delay_s for servo in asked), default=0.0)
        turns.append((delay_s, [servo.read_status(*parameters[:2]) for servo in asked]))
    return turns


def _bulk_read(parameters: bytes, servos: Sequence[VirtualServo]) -> list[Turn]:
    """A zero, and then size, ID and address of each; whoever comes after a silent one waits in vain."""
    turns: list[Turn] = []
    for at in range(1, len(parameters) - 2, 3):
        size, servo_id, address = parameters[at : at + 3]
        asked = named(servo_id, servos)
        if not asked:
            break
        turns.append((asked[0].return_delay_s, [servo.read_status(address, size) for servo in asked]))
    return turns


def _sync_write(parameters: bytes, servos: Sequence[VirtualServo]) -> None:
    """Address, size, and then an ID and ``size`` bytes for each servo; half an entry is ignored."""
    if len(parameters) < 2:
        return
    address, size = parameters[:2]
    for at in range(2, len(parameters) - size, size + 1):
        for servo in named(parameters[at], servos):
            servo.write(address, parameters[at + 1 : at + 1 + size])
