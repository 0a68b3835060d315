"""The turns of servos in extended position mode: outside the bus their positions are places within one turn.

Such a servo counts on over turns, and begins within one after each restart. So the bus takes whole turns off what it
reports, and adds them to its goals. Another number of turns counts only once a second reading confirms it: a false one
would send the joint a whole turn away.
"""

from collections.abc import Mapping

from drivers.bus.types import Reading, ServoGoal, ServoState
from drivers.servos.register import ServoModel


class Turns:
    """The servos of one line that are in extended position mode, by ID."""

    def __init__(self) -> None:
        self._counts_per_turn: dict[int, int] = {}
        self._turned: dict[int, int] = {}
        """Counts of the whole turns in each servo's readings."""
        self._doubted: dict[int, int] = {}
        """The same of the newest reading, if it differs."""

    def identified(self, servo_id: int, model: ServoModel, extended: bool) -> None:
        """Note whether the servo counts on over turns."""
        self._counts_per_turn.pop(servo_id, None)
        self._forget(servo_id)
        if extended:
            self._counts_per_turn[servo_id] = model.counts_per_turn

    def __contains__(self, servo_id: int) -> bool:
        return servo_id in self._counts_per_turn

    def readings(self, readings: Mapping[int, Reading]) -> Mapping[int, Reading]:
        """The readings with every position within one turn, or as far outside as an unconfirmed one says."""
        changed: dict[int, Reading] = {}
        for servo_id, turn in self._counts_per_turn.items():
            reading = readings.get(servo_id)
            if isinstance(reading, ServoState):
                self._take(servo_id, reading.position_counts // turn * turn)
                counts = reading.position_counts - self._turned[servo_id]
                changed[servo_id] = reading._replace(position_counts=counts)
            elif reading is not None and reading.kind == "reset":
                self._forget(servo_id)
        return {**readings, **changed} if changed else readings

    def _take(self, servo_id: int, turned: int) -> None:
        if turned in (self._turned.setdefault(servo_id, turned), self._doubted.pop(servo_id, None)):
            self._turned[servo_id] = turned
        else:
            self._doubted[servo_id] = turned

    def _forget(self, servo_id: int) -> None:
        self._turned.pop(servo_id, None)
        self._doubted.pop(servo_id, None)

    def goals(self, goals: Mapping[int, ServoGoal]) -> Mapping[int, ServoGoal]:
        """The goals in the turns that the servos are in."""
        changed = {
            i: goals[i]._replace(position_counts=goals[i].position_counts + turned)
            for i, turned in self._turned.items()
            if turned and i in goals
        }
        return {**goals, **changed} if changed else goals

    def goal(self, servo_id: int, held: int) -> int:
        """The goal that a servo holds, counted as its readings are."""
        return held - self._turned.get(servo_id, 0)
