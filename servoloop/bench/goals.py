"""Goals for a measurement that moves nothing, and only for servos that surely take them for goals."""

import logging
from collections.abc import Sequence
from dataclasses import dataclass, field
from functools import partial
from typing import Final

from drivers.bus.bus import Bus
from drivers.bus.confirm import confirmed_states
from drivers.bus.retry import retry
from drivers.bus.types import ServoGoal, ServoState
from drivers.errors import DriverError, ServoError, ServoRefused, ServoSilent
from drivers.servos.catalog import MODELS, series_of
from drivers.servos.dynamixel import X
from drivers.servos.feetech import STS
from drivers.servos.register import ServoModel
from hal.servos.diagnose import NO_BAUD_RATE, diagnose

LOG = logging.getLogger("servoloop")

TRIES: Final = 3
SEARCHED: Final = 8


def _turned(number: int) -> int:
    """Its two bytes in the other order."""
    return int.from_bytes(number.to_bytes(2, "little"), "big")


_NUMBERS: Final = frozenset(model.number for model in MODELS.values())
_KNOWN: Final = _NUMBERS | frozenset(map(_turned, _NUMBERS))
"""Also those of the other byte order, as a servo of another series would seem to say."""


class Mute(ServoError):
    """It gives its state together with others, and answers no question that it is asked by itself."""


@dataclass(frozen=True, slots=True)
class PresentGoals:
    """Goals by ID that move nobody: of servos that hold them already, and where limp ones stand.

    To a limp servo of most makes a goal is the order to switch its torque on.
    """

    held: dict[int, ServoGoal] = field(default_factory=dict)
    limp: dict[int, ServoGoal] = field(default_factory=dict)


def present_goals(bus: Bus, servo_ids: Sequence[int], model: ServoModel) -> PresentGoals:
    """Find the goal that each servo has already. Nothing is written.

    What is a goal to one model may be a setting to another: who has another table, is in another mode, stands where
    no goal can be or answers only later has none. Raises DriverError where nobody answers, ServoRefused where all
    have another table.
    """
    states = who_answers(bus, servo_ids)
    goals = PresentGoals()
    strangers: list[ServoRefused] = []
    mute: list[Mute] = []
    for servo_id, state in states.items():
        try:
            _find_goal(bus, servo_id, model, state, goals, patient=not mute)
        except ServoRefused as error:
            strangers.append(error)
            LOG.warning("%s: %s. It is read and gets no goal", bus.name, error)
        except Mute as error:
            mute.append(error)
        except ServoError as error:
            LOG.warning("%s: %s. It is read and gets no goal", bus.name, error)
    if len(strangers) == len(states):
        raise strangers[0]
    if len(mute) == len(states):  # a simulator, for no servo is so: the user's word is taken
        goals.limp.update({servo_id: ServoGoal(state.position_counts) for servo_id, state in states.items()})
    for one in mute if len(mute) < len(states) else ():
        LOG.warning("%s: %s. It is read and gets no goal", bus.name, one)
    return goals


def who_answers(bus: Bus, servo_ids: Sequence[int]) -> dict[int, ServoState]:
    """The states of all who do. Raises DriverError where nobody does."""
    states: dict[int, ServoState] = {}
    for _ in range(TRIES):
        missing = [i for i in servo_ids if i not in states]
        states |= {i: r for i, r in confirmed_states(bus.read_states, missing).items() if isinstance(r, ServoState)}
        if len(states) == len(servo_ids):
            return states
    if not states:
        raise DriverError(_why_nobody(bus, servo_ids))
    return states


def _why_nobody(bus: Bus, servo_ids: Sequence[int]) -> str:
    """In words. Of many servos the first few are searched at other rates: at slow ones that takes long."""
    found = [text for text in diagnose(bus, servo_ids[:SEARCHED]).values() if NO_BAUD_RATE not in text]
    check = "check the servos' power, their IDs and the baud rate"
    return f"no servo answers on {bus.name}: " + ("\n".join(found) or check)


def _find_goal(
    bus: Bus, servo_id: int, model: ServoModel, state: ServoState, goals: PresentGoals, *, patient: bool
) -> None:
    """Put one servo's goal into ``goals``, if it may have any. Raises ServoRefused for one with another table.

    ``patient``: no other has been mute yet. Where one has, all may be, and a second look at each would take long.
    """
    question = partial(bus.read, servo_id, series_of(model).model_number)
    try:
        number = retry(question) if patient else question()
    except ServoSilent as error:
        raise Mute(servo_id, "answers group reads and no others") from error
    try:
        bus.identify(servo_id, model)
    except ServoRefused as error:
        if number != model.number and not _has_the_table(bus, servo_id, model, number):
            raise
        if not _is_fit(bus, servo_id, model, number, error):
            return
    holds = bus.torque_is_on(servo_id)
    # Under a load it stands beside its goal: to make that the goal would lower the load, run by run.
    counts = bus.goal(servo_id) if holds else state.position_counts
    if model.positions and not 0 <= counts <= model.last_count:
        LOG.warning("%s: servo %d stands at %d, where no goal can be. It gets none", bus.name, servo_id, counts)
        return
    (goals.held if holds else goals.limp)[servo_id] = ServoGoal(counts)


def _is_fit(bus: Bus, servo_id: int, model: ServoModel, number: int, refused: ServoRefused) -> bool:
    """Whether one that ``identify`` refused takes goals for goals: of another motor, or a simulator."""
    if number == 0:  # so its settings may all be 0
        return True
    try:
        bus.check_settings(servo_id, model)
    except ServoRefused as error:
        LOG.warning("%s: %s. It is read and gets no goal", bus.name, error)
        return False
    LOG.warning("%s: %s. It is taken for one all the same", bus.name, refused)
    return True


def _has_the_table(bus: Bus, servo_id: int, model: ServoModel, number: int) -> bool:
    """Whether one with another number is likely to have the same registers.

    A simulator may have no number (0) or one of its own; then the
    user is believed, unless the table speaks against it.
    """
    if any(number == other.number and series_of(other) is series_of(model) for other in MODELS.values()):
        return True
    elsewhere = X if series_of(model).make == "feetech" else STS
    of_the_other_make = retry(partial(bus.read, servo_id, elsewhere.model_number)) in _KNOWN
    if of_the_other_make or (number in _KNOWN and _turned(number) != model.number):
        return False
    if number == 0:
        return True
    return retry(partial(bus.read, servo_id, series_of(model).servo_id)) == servo_id and (
        0 <= bus.goal(servo_id) <= model.last_count
    )
