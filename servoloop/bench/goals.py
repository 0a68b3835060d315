"""Find goals that cause no motion for servos whose goal register is known."""

import logging
from collections.abc import Sequence
from dataclasses import dataclass, field
from functools import partial
from typing import Final

from drivers.bus.bus import Bus
from drivers.bus.confirm import confirmed_states
from drivers.bus.retry import retry
from drivers.driver_errors import DriverError, ServoError, ServoRefused, ServoSilent
from drivers.servos.catalog import MODELS, series_of
from drivers.servos.dynamixel import X
from drivers.servos.feetech import STS
from drivers.servos.register import ServoModel
from drivers.types import ServoGoal, ServoState
from hal.servos.diagnose import NO_BAUD_RATE, diagnose

LOG = logging.getLogger("servoloop")

TRIES: Final = 3
SEARCHED: Final = 8
"""Maximum number of servos to search for at other baud rates."""
NO_GOAL: Final = "%s: %s; the servo is read but is not sent a goal"


def _swapped(number: int) -> int:
    """Return a 16-bit number with its bytes swapped."""
    return int.from_bytes(number.to_bytes(2, "little"), "big")


def _known() -> frozenset[int]:
    """Return all model numbers in both byte orders, because servos of another series may use the other byte order."""
    numbers = frozenset(model.number for model in MODELS.values())
    return numbers | frozenset(map(_swapped, numbers))


class OnlyGroupReadsError(ServoError):
    """Raised when a servo responds to group reads but not to single reads."""


@dataclass(frozen=True, slots=True)
class PresentGoals:
    """Goals that cause no motion, keyed by servo ID.

    With most makes, a goal also enables the torque, so servos whose torque is off are listed separately.
    """

    held: dict[int, ServoGoal] = field(default_factory=dict)
    """Current goals of servos whose torque is enabled."""
    limp: dict[int, ServoGoal] = field(default_factory=dict)
    """Current positions of servos whose torque is off."""


def present_goals(bus: Bus, servo_ids: Sequence[int], model: ServoModel) -> PresentGoals:
    """Find the current goal of each servo without writing anything.

    The goal register of one model may be the address of a setting on another model. Therefore, a servo is not sent a
    goal if its control table or operating mode differs, its position is outside the goal range, or it responds too
    late.

    Raises:
        DriverError: No servo responds.
        ServoRefused: The control table of every servo differs from that of ``model``.
    """
    states = answering_servos(bus, servo_ids)
    goals = PresentGoals()
    refused: list[ServoRefused] = []
    mute: list[OnlyGroupReadsError] = []
    for servo_id, state in states.items():
        try:
            _find_goal(bus, servo_id, model, state, goals, patient=not mute)
        except ServoRefused as error:
            refused.append(error)
            LOG.warning(NO_GOAL, bus.name, error)
        except OnlyGroupReadsError as error:
            mute.append(error)
        except ServoError as error:
            LOG.warning(NO_GOAL, bus.name, error)
    if len(refused) == len(states):
        raise refused[0]
    if len(mute) == len(states):  # only a simulator responds like this, so --model is trusted
        goals.limp.update({servo_id: ServoGoal(state.position_counts) for servo_id, state in states.items()})
    for one in mute if len(mute) < len(states) else ():
        LOG.warning(NO_GOAL, bus.name, one)
    return goals


def answering_servos(bus: Bus, servo_ids: Sequence[int]) -> dict[int, ServoState]:
    """Return the states of all servos that respond. Raises DriverError if none does."""
    states = _states(bus, servo_ids)
    if not states:
        raise DriverError(_why_no_answer(bus, servo_ids))
    return states


def silent_servos(bus: Bus, servo_ids: Sequence[int]) -> tuple[int, ...]:
    """Return the IDs of the servos that do not respond."""
    states = _states(bus, servo_ids)
    return tuple(i for i in servo_ids if i not in states)


def _states(bus: Bus, servo_ids: Sequence[int]) -> dict[int, ServoState]:
    """Return the states of the servos that respond within a few tries."""
    states: dict[int, ServoState] = {}
    for _ in range(TRIES):
        missing = [i for i in servo_ids if i not in states]
        states |= {i: r for i, r in confirmed_states(bus.read_states, missing).items() if isinstance(r, ServoState)}
        if len(states) == len(servo_ids):
            break
    return states


def _why_no_answer(bus: Bus, servo_ids: Sequence[int]) -> str:
    """Return a message with the likely cause. Only the first few servos are searched for at other baud rates, to save
    time."""
    found = [text for text in diagnose(bus, servo_ids[:SEARCHED]).values() if NO_BAUD_RATE not in text]
    check = "check the power of the servos, their IDs and the baud rate"
    return f"no servo responds on {bus.name}: " + ("\n".join(found) or check)


def _find_goal(
    bus: Bus, servo_id: int, model: ServoModel, state: ServoState, goals: PresentGoals, *, patient: bool
) -> None:
    """Add the goal of one servo to ``goals``, if the servo can be sent goals.

    If ``patient`` is True, a single read is retried. If one servo has responded only to group reads, other servos may
    do the same, and retries would take too long.

    Raises:
        ServoRefused: The control table of the servo differs from that of ``model``.
        OnlyGroupReadsError: The servo does not respond to single reads.
    """
    question = partial(bus.read, servo_id, series_of(model).model_number)
    try:
        number = retry(question) if patient else question()
    except ServoSilent as error:
        raise OnlyGroupReadsError(servo_id, "responds to group reads but not to single reads") from error
    try:
        bus.identify(servo_id, model)
    except ServoRefused as error:
        if number != model.number and not _has_table(bus, servo_id, model, number):
            raise
        if not _is_fit(bus, servo_id, model, number, error):
            return
    holds = bus.torque_is_on(servo_id)
    # A servo under load comes to rest away from its goal. If its position became the goal, the load would sink further
    # with each measurement.
    counts = bus.goal(servo_id) if holds else state.position_counts
    if model.positions and not 0 <= counts <= model.last_count:
        LOG.warning("%s: servo %d is not sent a goal because its position %d is outside the goal range",
                    bus.name, servo_id, counts)  # fmt: skip
        return
    (goals.held if holds else goals.limp)[servo_id] = ServoGoal(counts)


def _is_fit(bus: Bus, servo_id: int, model: ServoModel, number: int, refused: ServoRefused) -> bool:
    """Return whether a servo that ``identify`` rejected, such as a variant or a simulated servo, can be sent goals."""
    if number == 0:  # The settings of a simulated servo may all be 0.
        return True
    try:
        bus.check_settings(servo_id, model)
    except ServoRefused as error:
        LOG.warning(NO_GOAL, bus.name, error)
        return False
    LOG.warning("%s: %s; the servo is still measured as this model", bus.name, refused)
    return True


def _has_table(bus: Bus, servo_id: int, model: ServoModel, number: int) -> bool:
    """Return whether a servo with a different model number is likely to have the same control table.

    A simulated servo may report the model number 0 or any other number. In this case, --model is trusted unless the
    content of the control table contradicts it.
    """
    if any(number == other.number and series_of(other) is series_of(model) for other in MODELS.values()):
        return True
    elsewhere = X if series_of(model).make == "feetech" else STS
    of_the_other_make = retry(partial(bus.read, servo_id, elsewhere.model_number)) in _known()
    if of_the_other_make or (number in _known() and _swapped(number) != model.number):
        return False
    if number == 0:
        return True
    return retry(partial(bus.read, servo_id, series_of(model).servo_id)) == servo_id and (
        0 <= bus.goal(servo_id) <= model.last_count
    )
