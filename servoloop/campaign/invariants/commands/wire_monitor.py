"""Monitor the bytes on a bus for goals and torque commands that an arm must never receive."""

from collections import Counter
from collections.abc import Callable, Collection, Iterator, Sequence
from math import ceil, floor, inf, pi
from typing import Any, Final, NamedTuple, cast

from drivers.protocol.v1 import BROADCAST_ID
from drivers.servos import sts
from drivers.servos.catalog import registers_of, series_of
from drivers.servos.feetech import STS
from drivers.servos.register import ByteOrder, Register
from hal.joint import Joint
from sim_backend.buses.dynamixel import VirtualDynamixelBus
from sim_backend.line.line import ServoLine
from sim_backend.packets import dynamixel as dynamixel_wire
from sim_backend.packets import sts as sts_wire
from sim_backend.packets.dynamixel_groups import Span, bulk_entries, bulk_spans, sync_entries, sync_spans
from sim_backend.packets.instructions import Instruction, Parser

ROUNDING_COUNTS: Final = 1e-6
"""Tolerance for rounding a limit that is a whole number of counts."""
MEASURED_WITHIN_COUNTS: Final = 3
"""Tolerance for joints that sag between the measurement and the moment the torque is enabled, in counts."""
MEASURED_S: Final = 0.1
"""Maximum age of the measurement that becomes the goal of a limp joint, in seconds. Replies may be late."""
SWITCHED_ON_S: Final = 0.02
"""Maximum time to read the servos of an arm, send their goals and enable their torque, in seconds.

The stack cannot know how far a joint moves during this time.
"""
SPEED_SHARE: Final = 1.1
"""Maximum goal speed of a Feetech servo, as a fraction of its joint's velocity limit, so that the servo can catch
up."""
SPEED_COUNTS_S: Final = 101.0
"""Goal speed allowed in addition to ``SPEED_SHARE`` of the velocity limit, in counts/s."""
CONFIRMING_READS: Final = 2
"""Minimum number of position readings between the last setting written to a limp servo and the servo's first goal."""


class Broken(NamedTuple):
    """Violation on a bus."""

    joint: str
    text: str
    believes: bool
    """Whether the stack believed what the servo reported about its position or its torque."""


class _PositionRead(NamedTuple):
    """Position of a servo when it was read."""

    position: int
    """Position, in counts."""
    at_s: float
    """Time of the reading on the line's clock, in seconds."""


class WireMonitor:
    """Monitor that checks each packet in ``see`` before the servos receive it. ``broken`` lists the violations."""

    def __init__(
        self,
        joints: tuple[Joint, ...],
        line: ServoLine[Any],
        period_s: float,
        limp: Collection[str] = (),
        activating: Callable[[], bool] = lambda: False,
    ) -> None:
        """Monitor the servos of one bus.

        Args:
            joints: Joints whose servos are on the bus.
            line: The simulated bus.
            period_s: Period of the control loop, in seconds.
            limp: Names of joints that the stack must know are limp. The caller keeps these names up to date.
            activating: Function that returns whether the hardware is being activated, regardless of its servos' torque.
        """
        self._joints = {joint.servo_id: (joint, line.servo(joint.servo_id)) for joint in joints}
        self._series = {joint.servo_id: series_of(joint.model) for joint in joints}
        self._ranges = {joint.servo_id: _range(joint) for joint in joints}
        self._positions = {joint.servo_id: _position_address(joint) for joint in joints}
        self._line = line
        self._period_s = period_s
        second = isinstance(line, VirtualDynamixelBus)
        self._parser: Parser = dynamixel_wire.InstructionParser() if second else sts_wire.InstructionParser()
        self._writes, self._reads = (_writes_2, _reads_2) if second else (_writes_1, _reads_1)
        self._goals: dict[int, int] = {}
        self._measured: Counter[int] = Counter()
        """Number of position readings requested since the last setting was written, keyed by servo ID."""
        self._read_at: dict[int, _PositionRead] = {}
        """Last reading of each servo's position, keyed by servo ID."""
        self._placed_s: dict[int, float] = {}
        """Time at which each servo received its current goal, keyed by servo ID.

        Only servos that were at their goal at this time are included.
        """
        self._driven: set[int] = set()
        self._limp, self._activating = limp, activating
        self.enabled: set[str] = set()
        """Names of joints whose torque the stack has enabled since the caller last updated ``limp``.

        The servo of such a joint may lose its torque again before the stack can know. The caller clears this set.
        """
        self.broken: list[Broken] = []
        self.goals_seen = 0
        self.torque_on_seen = 0

    def see(self, data: bytes) -> None:
        """Check one write to the bus."""
        for instruction in self._parser.feed(data):
            for servo_id, address, size in self._reads(instruction):
                if servo_id in self._joints:
                    self._read(*self._joints[servo_id], address, size)
            for servo_id, address, content in self._writes(instruction):
                for one in self._joints if servo_id == BROADCAST_ID else {servo_id} & self._joints.keys():
                    self._written(*self._joints[one], address, content)

    def _read(self, joint: Joint, servo: Any, address: int, size: int) -> None:
        servo_id = joint.servo_id
        if self._positions[servo_id] in _addresses(servo.memory, address, size):
            self._measured[servo_id] += 1
            self._read_at[servo_id] = _PositionRead(round(servo.firmware.position), self._line.reached_s)

    def _written(self, joint: Joint, servo: Any, address: int, content: bytes) -> None:
        series = self._series[joint.servo_id]
        order = series.protocol.byte_order
        position = round(servo.firmware.position)
        places = _addresses(servo.memory, address, len(content))
        goal = _value(series.goal_position, order, places, content)
        torque = _value(series.torque_enable, order, places, content)
        limp = servo.memory.get(series.torque_enable) == 0
        if goal is not None:
            self._goal(joint, goal, position, limp)
            speed = _value(sts.goal_velocity, order, places, content) if series is STS else None
            if speed is not None and not limp and not self._activating():
                self._speed(joint, speed)
        if torque is not None:
            held = servo.memory.get(series.goal_position) if goal is None else goal
            receives = self._line.plugged(servo) and servo.deaf_s <= 0.0
            self._torque(joint, torque, position, held if limp and receives else None)
        if goal is None and torque is None:
            self._measured[joint.servo_id] = 0

    def _goal(self, joint: Joint, goal: int, position: int, limp: bool) -> None:
        self.goals_seen += 1
        lower, upper = self._ranges[joint.servo_id]
        before = self._goals.get(joint.servo_id)
        taken_over = limp or joint.servo_id not in self._driven or self._activating()
        begins = taken_over and self._is_here(joint, goal, position)
        self._placed_s.pop(joint.servo_id, None)
        if begins:
            self._placed_s[joint.servo_id] = self._line.reached_s
        returns = before is not None and (before <= goal < lower or upper < goal <= before)
        if not (lower <= goal <= upper or begins or returns):
            self._report(joint, f"goal {goal} is outside {lower} to {upper}", taken_over)
        reach = joint.limits.velocity * self._period_s / abs(joint.units_per_count) + 1.0
        if before is not None and abs(goal - before) > reach and not begins:
            self._report(joint, f"goal jumps from {before} to {goal}, by more than {reach:.1f} counts", taken_over)
        known = joint.name in self._limp and joint.name not in self.enabled
        if limp and (known or self._activating()) and not begins:
            self._report(joint, f"limp at {position} but sent goal {goal}")
        readings = self._measured[joint.servo_id]
        if limp and self._activating() and goal != before and readings < CONFIRMING_READS:
            self._report(joint, f"sent goal {goal} after {readings} readings, but {CONFIRMING_READS} must agree")
        self._goals[joint.servo_id] = goal

    def _speed(self, joint: Joint, speed: int) -> None:
        """Check the speed of a goal, in counts/s. At speed 0, an STS servo moves as fast as it can."""
        reach = joint.limits.velocity / abs(joint.units_per_count) + 1.0 / self._period_s  # whole counts per period
        fastest = SPEED_SHARE * reach + SPEED_COUNTS_S
        if not 0 < speed <= fastest:
            self._report(joint, f"goal speed {speed}, but at most {fastest:.0f} counts/s are allowed", believes=False)

    def _torque(self, joint: Joint, value: int, position: int, goal: int | None) -> None:
        """Check a write to the torque register. A servo that was driven since its last goal may have sagged.

        ``goal`` is the goal in the memory of a limp servo, which may have missed the goal that the stack sent. ``goal``
        is None if the servo's torque is enabled, or if the servo receives nothing because it has no power or is
        restarting.
        """
        if value != 1:
            self._driven.discard(joint.servo_id)
            return
        self.torque_on_seen += 1
        self.enabled.add(joint.name)
        placed_s = self._line.reached_s - self._placed_s.get(joint.servo_id, -inf)
        placed = placed_s <= SWITCHED_ON_S and goal == self._goals.get(joint.servo_id)
        if goal is None or joint.servo_id in self._driven or placed:
            self._driven.add(joint.servo_id)
            return
        if not self._is_here(joint, goal, position):
            self._report(joint, f"torque enabled at {position} with goal {goal}")
        self._driven.add(joint.servo_id)

    def _report(self, joint: Joint, text: str, believes: bool = True) -> None:
        self.broken.append(Broken(joint.name, text, believes))

    def _is_here(self, joint: Joint, goal: int, position: int) -> bool:
        """Return whether a goal is the position of a limp joint now, or at its last measurement, if that is recent."""
        read = self._read_at.get(joint.servo_id)
        recent = read is not None and self._line.reached_s - read.at_s <= MEASURED_S
        if read is not None and recent and abs(goal - read.position) <= MEASURED_WITHIN_COUNTS:
            return True
        return abs(goal - position) <= self._within_counts(joint)

    def _within_counts(self, joint: Joint) -> float:
        """Return the distance by which a limp joint may have moved since its last measurement, in counts."""
        servo = self._joints[joint.servo_id][1]
        velocity_rad_s = self._line.rig.plant.velocities()[self._line.servos.index(servo)]
        turns = abs(velocity_rad_s) * MEASURED_S / (2.0 * pi)
        return MEASURED_WITHIN_COUNTS + turns * joint.model.counts_per_turn


class GoalReader:
    """Extractor that finds goal positions, in counts, in the instructions on a bus."""

    def __init__(self, line: ServoLine[Any], joints: Sequence[Joint]) -> None:
        """Read the goals of the servos of these joints, which are on this bus."""
        second = isinstance(line, VirtualDynamixelBus)
        self._parser: Parser = dynamixel_wire.InstructionParser() if second else sts_wire.InstructionParser()
        self._writes = _writes_2 if second else _writes_1
        self._series = {joint.servo_id: series_of(joint.model) for joint in joints}
        self._memories = {joint.servo_id: line.servo(joint.servo_id).memory for joint in joints}

    def read(self, data: bytes) -> dict[int, int]:
        """Return the goals in one write to the bus, keyed by servo ID."""
        goals: dict[int, int] = {}
        for instruction in self._parser.feed(data):
            for servo_id, address, content in self._writes(instruction):
                for one in self._series if servo_id == BROADCAST_ID else {servo_id} & self._series.keys():
                    series = self._series[one]
                    places = _addresses(self._memories[one], address, len(content))
                    value = _value(series.goal_position, series.protocol.byte_order, places, content)
                    if value is not None:
                        goals[one] = value
        return goals


def _value(register: Register, order: ByteOrder, places: Sequence[int], content: bytes) -> int | None:
    """Return the value that a write stores in a register, or None if it does not write the whole register.

    Args:
        register: The register.
        order: Byte order of the servo.
        places: Address of each byte of the write.
        content: Bytes of the write.
    """
    if register.address not in places:
        return None
    if isinstance(places, range):
        first = register.address - places.start
        found = content[first : first + register.size]
        return register.decode(found, order) if len(found) == register.size else None
    written = dict(zip(places, content, strict=False))
    own = [written.get(register.address + i) for i in range(register.size)]
    return None if None in own else register.decode(bytes(cast(list[int], own)), order)


def _range(joint: Joint) -> tuple[int, int]:
    """Return the lowest and the highest count within a joint's limits, independently of the driver's conversion."""
    limits = joint.limits
    ends = [joint.zero_counts + limit / joint.units_per_count for limit in (limits.lower, limits.upper)]
    return ceil(min(ends) - ROUNDING_COUNTS), floor(max(ends) + ROUNDING_COUNTS)


def _position_address(joint: Joint) -> int:
    return next(register.address for register in registers_of(joint.model) if register.name == "present_position")


def _addresses(memory: Any, address: int, size: int) -> Sequence[int]:
    """Return the addresses of a read or write. Dynamixel servos have indirect addresses, which refer to bytes
    elsewhere."""
    return memory.resolved(address, size) if hasattr(memory, "resolved") else range(address, address + size)


def _reads_1(instruction: Instruction) -> Iterator[Span]:
    """Yield the servo ID, address and size of each read in an instruction of a Feetech protocol or Dynamixel 1.0."""
    parameters, code = instruction.parameters, sts_wire.Code
    if instruction.code == code.READ and len(parameters) > 1:
        yield instruction.servo_id, parameters[0], parameters[1]
    elif instruction.code == code.SYNC_READ and len(parameters) > 1:
        yield from ((servo_id, parameters[0], parameters[1]) for servo_id in parameters[2:])
    elif instruction.code == code.BULK_READ:  # a zero, followed by the size, ID and address for each servo
        for at in range(1, len(parameters) - 2, 3):
            yield parameters[at + 1], parameters[at + 2], parameters[at]


def _reads_2(instruction: Instruction) -> Iterator[Span]:
    """Yield the servo ID, the address and the size of each read in an instruction of Dynamixel 2.0."""
    parameters, code = instruction.parameters, dynamixel_wire.Code
    if instruction.code == code.READ:
        yield instruction.servo_id, int.from_bytes(parameters[:2], "little"), int.from_bytes(parameters[2:4], "little")
    elif instruction.code in (code.SYNC_READ, code.FAST_SYNC_READ):
        yield from sync_spans(parameters)
    elif instruction.code in (code.BULK_READ, code.FAST_BULK_READ):
        yield from bulk_spans(parameters)


def _writes_1(instruction: Instruction) -> Iterator[tuple[int, int, bytes]]:
    """Yield the servo ID, address and bytes of each write in an instruction of a Feetech protocol or Dynamixel 1.0."""
    parameters, code = instruction.parameters, sts_wire.Code
    if instruction.code in (code.WRITE, code.REG_WRITE) and parameters:
        yield instruction.servo_id, parameters[0], parameters[1:]
    elif instruction.code == code.SYNC_WRITE and len(parameters) > 1:
        address, size = parameters[:2]
        for at in range(2, len(parameters), size + 1):
            yield parameters[at], address, parameters[at + 1 : at + 1 + size]


def _writes_2(instruction: Instruction) -> Iterator[tuple[int, int, bytes]]:
    """Yield the servo ID, the address and the bytes of each write in an instruction of Dynamixel 2.0."""
    parameters, code = instruction.parameters, dynamixel_wire.Code
    if instruction.code in (code.WRITE, code.REG_WRITE):
        yield instruction.servo_id, int.from_bytes(parameters[:2], "little"), parameters[2:]
    elif instruction.code == code.SYNC_WRITE:
        yield from sync_entries(parameters)
    elif instruction.code == code.BULK_WRITE:
        yield from bulk_entries(parameters)
