"""Remove whole turns from the positions of servos in extended position mode.

Such a servo counts several turns, but after a reset its count restarts within a single turn. The bus therefore
subtracts whole turns from its readings and adds them to its goals. The number of turns changes only if a reading leaps
out of the turn, as after a reset, and a second reading confirms it. A wrong number would move the joint by a whole
turn. A driven shaft that is pushed past the end of its turn stays in this turn, as in position mode. A limp shaft is
always within its turn, no matter how many times it is turned by hand.
"""

from collections.abc import Iterable, Mapping

from drivers.servos.register import ServoModel
from drivers.types import Reading, ServoGoal, ServoState


class Turns:
    """The servos of one bus that are in extended position mode."""

    def __init__(self) -> None:
        self._counts_per_turn: dict[int, int] = {}
        self._whole_turns: dict[int, int] = {}
        """Whole turns in the readings of each servo, in counts."""
        self._unconfirmed: dict[int, int] = {}
        """Whole turns in the latest reading, in counts, of each servo whose number of turns is not confirmed yet."""
        self._positions: dict[int, int] = {}
        """Last position without whole turns, in counts, of each servo whose number of turns is confirmed."""
        self._driven: set[int] = set()
        """Servos whose torque may be enabled."""

    def identified(self, servo_id: int, model: ServoModel, extended: bool, held: int | None = None) -> None:
        """Note the mode of a servo.

        Args:
            servo_id: ID of the servo.
            model: Model of the servo.
            extended: Whether the servo is in a mode with turns.
            held: Goal of a servo whose torque is enabled, in counts. The servo is in the turn of this goal, even if
                something pushes it out of the turn. None means that the next reading determines the turn.
        """
        self._counts_per_turn.pop(servo_id, None)
        self._forget(servo_id)
        if not extended:
            return
        turn = self._counts_per_turn[servo_id] = model.counts_per_turn
        if held is not None:
            self._whole_turns[servo_id], self._positions[servo_id] = held // turn * turn, held % turn
            self._driven.add(servo_id)

    def released(self, servo_ids: Iterable[int]) -> None:
        """Note that the torque of these servos is disabled."""
        self._driven.difference_update(servo_ids)

    def __contains__(self, servo_id: int) -> bool:
        return servo_id in self._counts_per_turn

    def readings(self, readings: Mapping[int, Reading]) -> Mapping[int, Reading]:
        """Return the readings without whole turns. An unconfirmed position may be wrong by whole turns."""
        changed: dict[int, Reading] = {}
        for servo_id, turn in self._counts_per_turn.items():
            reading = readings.get(servo_id)
            if isinstance(reading, ServoState):
                counts = self._position(servo_id, reading.position_counts, turn)
                changed[servo_id] = reading._replace(position_counts=counts)
            elif reading is not None and reading.kind == "reset":
                self._forget(servo_id)
        return {**readings, **changed} if changed else readings

    def _position(self, servo_id: int, counts: int, turn: int) -> int:
        """Return the position of a reading without the whole turns, which this method updates."""
        reset = counts // turn * turn
        """Whole turns in the reading if the servo was reset."""
        position = counts - self._whole_turns.setdefault(servo_id, reset)
        unconfirmed = self._unconfirmed.pop(servo_id, None)
        leapt = abs(position - self._positions.get(servo_id, position)) >= turn // 2
        if not 0 <= position < turn and (leapt or servo_id not in self._driven):
            if reset != unconfirmed:
                self._unconfirmed[servo_id] = reset
                return position
            self._whole_turns[servo_id] = reset
            position = counts - reset
        self._positions[servo_id] = position
        return position

    def _forget(self, servo_id: int) -> None:
        for values in (self._whole_turns, self._unconfirmed, self._positions):
            values.pop(servo_id, None)
        self._driven.discard(servo_id)

    def goals(self, goals: Mapping[int, ServoGoal]) -> Mapping[int, ServoGoal]:
        """Return the goals with the whole turns of their servos. Some servos enable torque when they receive a goal."""
        self._driven.update(goals.keys() & self._counts_per_turn.keys())
        changed = {
            i: goals[i]._replace(position_counts=goals[i].position_counts + whole_turns)
            for i, whole_turns in self._whole_turns.items()
            if whole_turns and i in goals
        }
        return {**goals, **changed} if changed else goals

    def goal(self, servo_id: int, held: int) -> int:
        """Return the goal of a servo without its whole turns."""
        return held - self._whole_turns.get(servo_id, 0)
