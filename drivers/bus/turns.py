"""Remove whole turns from the positions of servos in extended position mode.

Such a servo counts several turns, but after a reset its count restarts within a single turn. The bus therefore
subtracts whole turns from its readings and adds them to its goals. A second reading must confirm a change in the number
of turns, because a wrong number would move the joint by a whole turn.
"""

from collections.abc import Mapping

from drivers.servos.register import ServoModel
from drivers.types import Reading, ServoGoal, ServoState


class Turns:
    """The servos of one bus that are in extended position mode."""

    def __init__(self) -> None:
        self._counts_per_turn: dict[int, int] = {}
        self._whole_turns: dict[int, int] = {}
        """Whole turns in the readings of each servo, in counts."""
        self._unconfirmed: dict[int, int] = {}
        """Whole turns in the latest reading of each servo, in counts, if not confirmed yet."""

    def identified(self, servo_id: int, model: ServoModel, extended: bool) -> None:
        self._counts_per_turn.pop(servo_id, None)
        self._forget(servo_id)
        if extended:
            self._counts_per_turn[servo_id] = model.counts_per_turn

    def __contains__(self, servo_id: int) -> bool:
        return servo_id in self._counts_per_turn

    def readings(self, readings: Mapping[int, Reading]) -> Mapping[int, Reading]:
        """Return the readings without whole turns. An unconfirmed position may be outside a single turn."""
        changed: dict[int, Reading] = {}
        for servo_id, turn in self._counts_per_turn.items():
            reading = readings.get(servo_id)
            if isinstance(reading, ServoState):
                self._update(servo_id, reading.position_counts // turn * turn)
                counts = reading.position_counts - self._whole_turns[servo_id]
                changed[servo_id] = reading._replace(position_counts=counts)
            elif reading is not None and reading.kind == "reset":
                self._forget(servo_id)
        return {**readings, **changed} if changed else readings

    def _update(self, servo_id: int, whole_turns: int) -> None:
        if whole_turns in (self._whole_turns.setdefault(servo_id, whole_turns), self._unconfirmed.pop(servo_id, None)):
            self._whole_turns[servo_id] = whole_turns
        else:
            self._unconfirmed[servo_id] = whole_turns

    def _forget(self, servo_id: int) -> None:
        self._whole_turns.pop(servo_id, None)
        self._unconfirmed.pop(servo_id, None)

    def goals(self, goals: Mapping[int, ServoGoal]) -> Mapping[int, ServoGoal]:
        changed = {
            i: goals[i]._replace(position_counts=goals[i].position_counts + whole_turns)
            for i, whole_turns in self._whole_turns.items()
            if whole_turns and i in goals
        }
        return {**goals, **changed} if changed else goals

    def goal(self, servo_id: int, held: int) -> int:
        """Return the goal of a servo without its whole turns."""
        return held - self._whole_turns.get(servo_id, 0)
