"""Reads along on the wire and holds every byte against what an arm must never be told."""

from collections.abc import Iterator

from hal.joint import Joint
from sim_backend.bus import VirtualBus
from sim_backend.instructions import Instruction
from sim_backend.servo import VirtualServo
from sim_backend.sts_wire import Code, InstructionParser

TORQUE_ENABLE, GOAL_POSITION = 40, 42
MEASURED_WITHIN_COUNTS = 3
"""Free joints sag between the measurement and the torque."""


class WireMonitor:
    """``see`` is called with every packet before the servos hear it; ``broken`` lists what was wrong."""

    def __init__(self, joints: tuple[Joint, ...], bus: VirtualBus, period_s: float) -> None:
        self._joints = {joint.servo_id: joint for joint in joints}
        self._bus = bus
        self._period_s = period_s
        self._parser = InstructionParser()
        self._goals: dict[int, int] = {}
        self._driven: set[int] = set()
        self.broken: list[str] = []
        self.goals_seen = 0
        self.torque_on_seen = 0

    def see(self, data: bytes) -> None:
        """One write of the master."""
        for instruction in self._parser.feed(data):
            for servo_id, address, content in _writes(instruction):
                self._written(servo_id, address, content)

    def _written(self, servo_id: int, address: int, content: bytes) -> None:
        goal_at, torque_at = GOAL_POSITION - address, TORQUE_ENABLE - address
        if goal_at >= 0 and goal_at + 2 <= len(content):
            self._goal(self._joints[servo_id], int.from_bytes(content[goal_at : goal_at + 2], "little"))
        if 0 <= torque_at < len(content):
            self._torque(self._joints[servo_id], content[torque_at])

    def _goal(self, joint: Joint, raw: int) -> None:
        goal = -(raw & 0x7FFF) if raw & 0x8000 else raw
        self.goals_seen += 1
        lower, upper = joint.counts_range()
        if not lower <= goal <= upper:
            self.broken.append(f"{joint.name}: goal {goal} is outside {lower} to {upper}")
        reach = joint.limits.velocity * self._period_s / abs(joint.units_per_count) + 1.0
        before = self._goals.get(joint.servo_id)
        if before is not None and abs(goal - before) > reach:
            self.broken.append(f"{joint.name}: goal leaps from {before} to {goal}, more than {reach:.1f}")
        self._goals[joint.servo_id] = goal

    def _torque(self, joint: Joint, value: int) -> None:
        if value != 1:
            self._driven.discard(joint.servo_id)
            return
        self.torque_on_seen += 1
        servo = self._bus.servo(joint.servo_id)
        assert isinstance(servo, VirtualServo), "a line of STS servos"
        position = servo.firmware.position
        goal = self._goals.get(joint.servo_id)
        if joint.servo_id not in self._driven and (goal is None or abs(goal - position) > MEASURED_WITHIN_COUNTS):
            self.broken.append(f"{joint.name}: torque on at {position} with goal {goal}")
        self._driven.add(joint.servo_id)


def _writes(instruction: Instruction) -> Iterator[tuple[int, int, bytes]]:
    """Servo, address and bytes of everything that an instruction writes."""
    parameters = instruction.parameters
    if instruction.code in (Code.WRITE, Code.REG_WRITE):
        yield instruction.servo_id, parameters[0], parameters[1:]
    elif instruction.code == Code.SYNC_WRITE:
        address, size = parameters[:2]
        for at in range(2, len(parameters), size + 1):
            yield parameters[at], address, parameters[at + 1 : at + 1 + size]
