"""A Dynamixel line with self-made servos that support only pings, reads and writes, as many microcontrollers do."""

from collections.abc import Collection, Mapping, Sequence

from drivers.bus.bus import Bus
from drivers.servos.register import ServoModel
from sim_backend.buses.dynamixel import VirtualDynamixelBus
from sim_backend.buses.port import VirtualPort
from sim_backend.clock import SimulatedClock
from sim_backend.line.line import DelayedReply
from sim_backend.mechanics.plant import BenchPlant
from sim_backend.packets.dynamixel import Code
from sim_backend.packets.instructions import Instruction
from sim_backend.servos.dynamixel.protocol2_servo import Protocol2Servo

GROUP_READS = frozenset({Code.SYNC_READ, Code.BULK_READ, Code.FAST_SYNC_READ, Code.FAST_BULK_READ})
GROUP_WRITES = frozenset({Code.SYNC_WRITE, Code.BULK_WRITE})


class PlainSlaveBus(VirtualDynamixelBus):
    """A line on which the servos in ``plain`` ignore the instructions in ``ignored``."""

    plain: Collection[int] = ()
    ignored: Collection[int] = GROUP_READS | GROUP_WRITES

    def _execute(
        self, instruction: Instruction, at_s: float, byte_s: float, servos: Sequence[Protocol2Servo]
    ) -> list[DelayedReply]:
        if instruction.code in self.ignored:
            servos = [servo for servo in servos if servo.servo_id not in self.plain]
        return super()._execute(instruction, at_s, byte_s, servos)


class PlainLine:
    """Servos of these models, some of which ignore group instructions, and their bus."""

    def __init__(
        self,
        models: Mapping[int, ServoModel],
        plain: Collection[int],
        ignored: Collection[int] = GROUP_READS | GROUP_WRITES,
    ) -> None:
        self.clock = SimulatedClock(5.0)
        self.plant = BenchPlant(tuple(models))
        self.plant.place([1.0 + 0.1 * number for number in range(len(models))])
        self.servos = PlainSlaveBus.of(self.plant, models)
        assert isinstance(self.servos, PlainSlaveBus)
        self.servos.plain, self.servos.ignored = plain, ignored
        self.port = VirtualPort(self.servos, self.clock)
        self.bus = Bus(self.port, self.clock, models)
