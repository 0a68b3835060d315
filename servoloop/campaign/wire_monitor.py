"""Reads along on the wire and holds every byte against what an arm must never be told."""

from collections.abc import Collection, Iterator
from typing import Any, Final

from drivers.servos.catalog import series_of
from drivers.servos.register import Register
from hal.joint import Joint
from sim_backend.wire import dynamixel_wire, sts_wire
from sim_backend.wire.dynamixel_bus import VirtualDynamixelBus
from sim_backend.wire.dynamixel_groups import bulk_entries, sync_entries
from sim_backend.wire.instructions import Instruction, Parser
from sim_backend.wire.line import ServoLine

MEASURED_WITHIN_COUNTS: Final = 3
"""Free joints sag between the measurement and the torque."""


class WireMonitor:
    """``see`` is called with every packet before the servos hear it; ``broken`` lists what was wrong."""

    def __init__(
        self, joints: tuple[Joint, ...], line: ServoLine[Any], period_s: float, limp: Collection[str] = ()
    ) -> None:
        """``limp``: the joints that have had no torque for longer than may stay unknown, as they are at each packet."""
        self._joints = {joint.servo_id: (joint, line.servo(joint.servo_id)) for joint in joints}
        self._period_s = period_s
        second = isinstance(line, VirtualDynamixelBus)
        self._parser: Parser = dynamixel_wire.InstructionParser() if second else sts_wire.InstructionParser()
        self._writes = _writes_2 if second else _writes_1
        self._goals: dict[int, int] = {}
        self._driven: set[int] = set()
        self._limp = limp
        self.broken: list[str] = []
        self.goals_seen = 0
        self.torque_on_seen = 0

    def see(self, data: bytes) -> None:
        """One write of the master."""
        for instruction in self._parser.feed(data):
            for servo_id, address, content in self._writes(instruction):
                if servo_id in self._joints:
                    self._written(*self._joints[servo_id], address, content)

    def _written(self, joint: Joint, servo: Any, address: int, content: bytes) -> None:
        series = series_of(joint.model)
        memory = servo.memory
        # Dynamixels have cells that stand for bytes elsewhere.
        meant = memory.resolved(address, len(content)) if hasattr(memory, "resolved") else range(address, 1 << 16)
        told = dict(zip(meant, content, strict=False))

        def value(register: Register) -> int | None:
            places = range(register.address, register.address + register.size)
            if not all(place in told for place in places):
                return None
            return register.decode(bytes(told[place] for place in places), series.protocol.byte_order)

        position = round(servo.firmware.position)
        if (goal := value(series.goal_position)) is not None:
            self._goal(joint, goal, position)
        if (torque := value(series.torque_enable)) is not None:
            self._torque(joint, torque, position)

    def _goal(self, joint: Joint, goal: int, position: int) -> None:
        self.goals_seen += 1
        lower, upper = joint.counts_range()
        before = self._goals.get(joint.servo_id)
        begins = joint.servo_id not in self._driven and abs(goal - position) <= MEASURED_WITHIN_COUNTS
        returns = before is not None and (before <= goal < lower or upper < goal <= before)
        if not (lower <= goal <= upper or begins or returns):
            self.broken.append(f"{joint.name}: goal {goal} is outside {lower} to {upper}")
        reach = joint.limits.velocity * self._period_s / abs(joint.units_per_count) + 1.0
        if before is not None and abs(goal - before) > reach:
            self.broken.append(f"{joint.name}: goal leaps from {before} to {goal}, more than {reach:.1f}")
        if joint.name in self._limp and abs(goal - position) > MEASURED_WITHIN_COUNTS:
            self.broken.append(f"{joint.name}: is limp at {position}, and told to go to {goal}")
        self._goals[joint.servo_id] = goal

    def _torque(self, joint: Joint, value: int, position: int) -> None:
        if value != 1:
            self._driven.discard(joint.servo_id)
            return
        self.torque_on_seen += 1
        goal = self._goals.get(joint.servo_id)
        if joint.servo_id not in self._driven and (goal is None or abs(goal - position) > MEASURED_WITHIN_COUNTS):
            self.broken.append(f"{joint.name}: torque on at {position} with goal {goal}")
        self._driven.add(joint.servo_id)


def _writes_1(instruction: Instruction) -> Iterator[tuple[int, int, bytes]]:
    """Servo, address and bytes of everything that an instruction of Feetech's protocols or Dynamixel 1.0 writes."""
    parameters, code = instruction.parameters, sts_wire.Code
    if instruction.code in (code.WRITE, code.REG_WRITE) and parameters:
        yield instruction.servo_id, parameters[0], parameters[1:]
    elif instruction.code == code.SYNC_WRITE and len(parameters) > 1:
        address, size = parameters[:2]
        for at in range(2, len(parameters), size + 1):
            yield parameters[at], address, parameters[at + 1 : at + 1 + size]


def _writes_2(instruction: Instruction) -> Iterator[tuple[int, int, bytes]]:
    """The same of Dynamixel 2.0."""
    parameters, code = instruction.parameters, dynamixel_wire.Code
    if instruction.code in (code.WRITE, code.REG_WRITE):
        yield instruction.servo_id, int.from_bytes(parameters[:2], "little"), parameters[2:]
    elif instruction.code == code.SYNC_WRITE:
        yield from sync_entries(parameters)
    elif instruction.code == code.BULK_WRITE:
        yield from bulk_entries(parameters)
