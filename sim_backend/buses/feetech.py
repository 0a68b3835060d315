"""Virtual Feetech servos and Dynamixel protocol 1.0 servos on one bus. The servos convert timed instructions to timed
replies.

STS servos behave as described in docs/simulation.md:
- They wait until the bus is idle, and then reply to all packets that arrived in one piece.
- In a sync read and a broadcast ping, each servo replies in its own time slot and does not listen to the others.
- All servos reply to a broadcast read at the same time.

According to the manuals of the other servos:
- Servos do not reply to a broadcast.
- The servos reply to a bulk read in the order in which the instruction lists them. Each servo waits for the previous
  reply, so a silent servo prevents the servos after it from replying.

Assumed for the other servos: they reply to a broadcast ping one after the other, in ID order.
"""

from collections.abc import Iterator, Mapping, Sequence
from math import ceil

from drivers.servos import ax_mx as dynamixel1
from drivers.servos import sts
from drivers.servos.catalog import series_of
from drivers.servos.register import ServoModel
from sim_backend.line.line import DelayedReply, ServoLine, Turn, named
from sim_backend.line.rig import Rig, Supply
from sim_backend.line.spread import NOMINAL, Spread
from sim_backend.mechanics.motor import sts_motor
from sim_backend.mechanics.plant import Plant
from sim_backend.packets.instructions import Instruction
from sim_backend.packets.sts import BROADCAST, LONGEST_DATA, Code, InstructionParser, StsParser
from sim_backend.servos.dynamixel.protocol1_servo import VirtualAxServo, VirtualMxServo
from sim_backend.servos.generic.packet_servo import PacketServo
from sim_backend.servos.generic.scs_servo import VirtualScsServo
from sim_backend.servos.sts.firmware import AS_REIMPLEMENTED, StsVariant
from sim_backend.servos.sts.servo import VirtualServo
from sim_backend.servos.sts.state import TABLE_SIZE

_ID_AT = 2
_SLOT_PAUSE = 3
"""Pause between two replies to a sync read, in byte times."""
_PING_SLOT = 9
"""Length of a slot for a reply to a broadcast ping, in byte times. An STS servo uses the slot of its ID."""
_LONGEST_ENTRY = 125
"""Maximum number of bytes per servo in a sync write. A longer instruction is ignored."""


class VirtualBus(ServoLine[PacketServo]):
    """A bus of servos that share a packet format.

    Times are on the caller's clock. The simulated time of the servos starts at the first call.
    """

    def __init__(self, rig: Rig[PacketServo], *, paced: bool = True) -> None:
        """Create the line. If ``paced`` is true, bytes take time on the wire. If not, they take no time, which is
        useful for measuring software."""
        others = [servo for servo in rig.servos if not isinstance(servo, VirtualServo)]
        super().__init__(rig, InstructionParser() if others else StsParser(), _ID_AT, paced=paced)
        self._waiting: dict[VirtualServo, bytes] = {}
        """Replies of STS servos, queued until the bus is idle."""

    @classmethod
    def of(
        cls,
        plant: Plant,
        model: ServoModel | Mapping[int, ServoModel] = sts.STS3215,
        *,
        supply: Supply | None = None,
        paced: bool = True,
        variant: StsVariant = AS_REIMPLEMENTED,
        spread: Spread = NOMINAL,
    ) -> "VirtualBus":
        """Create a bus with one new servo for each coupling of ``plant``. ``model`` is the model of all servos, or a
        mapping from ID to model.

        All servos are set up for 1 Mbit/s and no return delay. STS servos have the firmware ``variant``, and their
        motors deviate from the nominal motor by ``spread``. If ``supply`` is None, servos with the same rated voltage
        share a supply, whose voltage deviates by ``spread``.
        """
        models = {c.servo_id: model if isinstance(model, ServoModel) else model[c.servo_id] for c in plant.couplings}
        servos = [servo_of(own, servo_id, variant, spread) for servo_id, own in models.items()]
        usual = {servo.model.rated_voltage_v: Supply(servo.model.rated_voltage_v) for servo in servos}
        rated = {voltage_v: spread.supply(one) for voltage_v, one in usual.items()}
        return cls(Rig(servos, plant, supply or [rated[servo.model.rated_voltage_v] for servo in servos]), paced=paced)

    def _execute(
        self, instruction: Instruction, at_s: float, byte_s: float, servos: Sequence[PacketServo]
    ) -> list[DelayedReply]:
        """Let ``servos`` execute one instruction, and return the replies in order."""
        parameters, broadcast = instruction.parameters, instruction.servo_id == BROADCAST
        meant = servos if broadcast else named(instruction.servo_id, servos)
        if instruction.code == Code.SYNC_READ:
            return self._sync_read(parameters, at_s, byte_s, meant)
        if instruction.code == Code.BULK_READ:
            knowing = [servo for servo in meant if servo.GROUP_READ == Code.BULK_READ]
            if knowing:
                return self._chained(_bulk_read(parameters, knowing), at_s, byte_s)
        if instruction.code == Code.SYNC_WRITE:
            _sync_write(parameters, meant)
        if broadcast:
            return self._broadcast(instruction, at_s, byte_s, meant)
        self._keep_back(meant, instruction)
        others = [servo for servo in meant if not isinstance(servo, VirtualServo)]
        return self._in_turn(self._answers(instruction, others), at_s, byte_s, 0.0)

    def _keep_back(self, servos: Sequence[PacketServo], instruction: Instruction) -> None:
        """Queue the replies of STS servos until the bus is idle. A read instruction discards earlier queued replies of
        the same servo."""
        for servo in servos:
            packet = servo.answer(instruction) if isinstance(servo, VirtualServo) else None
            if isinstance(servo, VirtualServo) and packet is not None:
                before = b"" if instruction.code == Code.READ else self._waiting.get(servo, b"")
                self._waiting[servo] = before + packet

    def _silence(self, at_s: float, byte_s: float) -> list[DelayedReply]:
        turns: dict[float, list[bytes]] = {}
        for servo, packets in self._waiting.items():
            turns.setdefault(servo.return_delay_s if self.paced else 0.0, []).append(packets)
        self._waiting.clear()
        return [self._reply(packets, at_s + delay_s, byte_s) for delay_s, packets in sorted(turns.items())]

    def _sync_read(
        self, parameters: bytes, at_s: float, byte_s: float, servos: Sequence[PacketServo]
    ) -> list[DelayedReply]:
        """Reply to a sync read (address, size, IDs).

        Each ID has a time slot; a servo that is listed twice replies once.
        """
        if len(parameters) < 2:
            return []
        address, size = parameters[:2]
        replies = []
        knowing = [servo for servo in servos if servo.GROUP_READ == Code.SYNC_READ and address < TABLE_SIZE]
        listed = parameters[2:]
        for servo_id in dict.fromkeys(listed):
            asked = named(servo_id, knowing)
            packets = [servo.read_status(address, size) for servo in asked]
            for servo in asked:
                self._waiting.pop(servo, None)  # type: ignore[call-overload]
            if packets:
                slot_s = (len(packets[0]) + _SLOT_PAUSE) * _timed_byte_s(byte_s)
                replies.append(self._reply(packets, at_s + max(byte_s, listed.index(servo_id) * slot_s), byte_s))
        return replies

    def _broadcast(
        self, instruction: Instruction, at_s: float, byte_s: float, servos: Sequence[PacketServo]
    ) -> list[DelayedReply]:
        """Return the replies to a broadcast. Most broadcasts have no reply."""
        own_time = [servo for servo in servos if isinstance(servo, VirtualServo)]
        others = self._answers(instruction, [servo for servo in servos if not isinstance(servo, VirtualServo)])
        if instruction.code == Code.READ:
            self._keep_back(own_time, instruction)
            return []
        turns = self._answers(instruction, own_time)
        if instruction.code != Code.PING:
            return []
        replies = [
            self._reply(packets, at_s + max(byte_s, _PING_SLOT * packets[0][_ID_AT] * _timed_byte_s(byte_s)), byte_s)
            for _, packets in turns
        ]
        return replies + self._in_turn(others, at_s, byte_s, 0.0)


def servo_of(
    model: ServoModel, servo_id: int, variant: StsVariant = AS_REIMPLEMENTED, spread: Spread = NOMINAL
) -> PacketServo:
    """Create a servo of ``model``. An STS servo has the given firmware variant, and its motor deviates from the nominal
    motor by ``spread``."""
    if isinstance(model, dynamixel1.AxMxModel):
        servo = (VirtualMxServo if model.bulk_read else VirtualAxServo)(model, servo_id)
        servo.memory.save(dynamixel1.baud_rate, 1)
        servo.memory.save(dynamixel1.return_delay, 0)
        return servo
    alone = series_of(model).make == "feetech" and series_of(model).protocol.group_read == "none"
    if alone:
        return VirtualScsServo(model, servo_id)
    return VirtualServo(model, servo_id, spread.motor(sts_motor(model), servo_id), variant)


def _timed_byte_s(byte_s: float) -> float:
    """Return the duration of one byte as an STS servo's timer measures it, rounded up to whole microseconds."""
    return ceil(byte_s * 1e6 - 1e-6) * 1e-6


def _bulk_read(parameters: bytes, servos: Sequence[PacketServo]) -> Iterator[Turn]:
    """Yield the replies to a bulk read, whose parameters are a zero, then the size, ID and address for each servo.

    A servo that follows a silent servo does not reply. A servo does not reply if the
    requested bytes do not fit into one reply (assumed).
    """
    for at in range(1, len(parameters) - 2, 3):
        size, servo_id, address = parameters[at : at + 3]
        asked = named(servo_id, servos)
        if not asked or size > LONGEST_DATA:
            break
        yield asked[0].return_delay_s, [servo.read_status(address, size) for servo in asked]


def _sync_write(parameters: bytes, servos: Sequence[PacketServo]) -> None:
    """Execute a sync write: an address, a size, then an ID and ``size`` bytes for each servo. If there are several
    entries for an ID, the last one is used.

    If an entry is truncated, an STS servo executes the part that arrived.
    """
    if len(parameters) < 2 or parameters[1] > _LONGEST_ENTRY:
        return
    address, size = parameters[:2]
    entries = {parameters[at]: parameters[at + 1 : at + 1 + size] for at in range(2, len(parameters), size + 1)}
    for servo_id, data in entries.items():
        for servo in named(servo_id, servos):
            if data and (len(data) == size or isinstance(servo, VirtualServo)):
                servo.write(address, data)
