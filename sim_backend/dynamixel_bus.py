"""Virtual Dynamixel servos on one wire: bytes and a time in, bytes and their arrival out.

From the e-manual: no reply to a broadcast other than a ping, which all answer in turn; a sync read is
answered in the order in which it names the servos. What a servo does whose predecessor stays silent,
the e-manual does not say: here its turn is a slot in time, or, with ``chained``, it waits in vain.
"""

from collections.abc import Mapping, Sequence
from typing import Final

from drivers.dynamixel import x_series
from drivers.registers import ServoModel
from sim_backend.dynamixel_servo import VirtualXServo
from sim_backend.dynamixel_wire import BROADCAST, STATUS_OVERHEAD, Code, InstructionParser
from sim_backend.line import Reply, ServoLine, Turn, named
from sim_backend.plant import Plant
from sim_backend.rig import Rig, Supply
from sim_backend.sts_wire import Instruction

_ID_AT: Final = 4
_MEGABAUD: Final = x_series.BAUD_RATES.index(1_000_000)


class VirtualDynamixelBus(ServoLine[VirtualXServo]):
    """A line of X series servos. Times are the caller's clock; the rig's time begins with the first call."""

    def __init__(self, rig: Rig[VirtualXServo], *, paced: bool = True) -> None:
        """``paced`` bytes take their time on the wire; unpaced ones none (to measure software)."""
        super().__init__(rig, InstructionParser(), _ID_AT, paced=paced)
        self.chained = False

    @classmethod
    def of(
        cls,
        plant: Plant,
        models: Mapping[int, ServoModel],
        *,
        supply: Supply | None = None,
        paced: bool = True,
    ) -> "VirtualDynamixelBus":
        """A bus with a servo (its model by its ID) for each coupling of ``plant``.

        They are set up as for an arm: 1 Mbit/s and no return delay. Without ``supply``, those of one rated
        voltage share a supply of it, as where a converter feeds the 5 V servos of a 12 V arm.
        """
        servos = [VirtualXServo(models[coupling.servo_id], coupling.servo_id) for coupling in plant.couplings]
        for servo in servos:
            servo.memory.put(x_series.baud_rate, _MEGABAUD)
            servo.memory.put(x_series.return_delay, 0)
        rated = {voltage_v: Supply(voltage_v) for voltage_v in {s.model.rated_voltage_v for s in servos}}
        return cls(Rig(servos, plant, supply or [rated[s.model.rated_voltage_v] for s in servos]), paced=paced)

    def _obey(
        self, instruction: Instruction, at_s: float, byte_s: float, servos: Sequence[VirtualXServo]
    ) -> list[Reply]:
        parameters = instruction.parameters
        if instruction.code == Code.SYNC_WRITE:
            _sync_write(parameters, servos)
            return []
        if instruction.code == Code.SYNC_READ:
            size = int.from_bytes(parameters[2:4], "little")
            return self._in_turn(self._sync_read(parameters, servos), at_s, byte_s, (STATUS_OVERHEAD + size) * byte_s)
        broadcast = instruction.servo_id == BROADCAST
        turns = self._answers(instruction, servos if broadcast else named(instruction.servo_id, servos))
        if broadcast and instruction.code != Code.PING:
            return []
        return self._in_turn(turns, at_s, byte_s, 0.0)

    def _sync_read(self, parameters: bytes, servos: Sequence[VirtualXServo]) -> list[Turn]:
        """Address, size, and then the IDs: a turn for each of them, whether anybody is there or not."""
        address, size = (int.from_bytes(parameters[at : at + 2], "little") for at in (0, 2))
        turns: list[Turn] = []
        for servo_id in parameters[4:]:
            asked = named(servo_id, servos)
            if self.chained and not asked:
                break
            delay_s = max((servo.return_delay_s for servo in asked), default=0.0)
            turns.append((delay_s, [servo.read_status(address, size) for servo in asked]))
        return turns


def _sync_write(parameters: bytes, servos: Sequence[VirtualXServo]) -> None:
    """Address, size, and then an ID and ``size`` bytes for each servo; half an entry is ignored."""
    if len(parameters) < 4:
        return
    address, size = (int.from_bytes(parameters[at : at + 2], "little") for at in (0, 2))
    for at in range(4, len(parameters) - size, size + 1):
        for servo in named(parameters[at], servos):
            servo.write(address, parameters[at + 1 : at + 1 + size])
