"""Write a passport back to the servos. All servos are checked first, and only values that differ are written."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field

from commissioning.passport.compare import require_model, servo_differences
from commissioning.passport.file import Passport, PassportError
from commissioning.provision import drives, persistent_registers, provision
from commissioning.scan.answers import Answer, who_answers
from drivers.bus.bus import Bus
from drivers.clock import Clock
from drivers.driver_errors import ServoError
from drivers.eeprom import ANSWERS_NO_READ, LEAVES_THE_LINE, Change
from drivers.servos.register import Access, Register, ServoModel
from hal.servos.limp_arm import torque_warning

NOT_WRITTEN = LEAVES_THE_LINE
"""Registers that are not restored. A servo that responds on this bus already has the right baud rate and protocol."""


@dataclass(frozen=True, slots=True)
class Restoration:
    """Values to write to one servo."""

    servo_id: int
    """Current ID of the servo."""
    model: ServoModel
    values: Mapping[Register, int]
    """Values to write, including the ID if it changes."""
    now: Mapping[str, int] = field(default_factory=dict)
    """Current values of these registers, keyed by name."""


def plan_restore(bus: Bus, passport: Passport, servo_id: int | None = None) -> list[Restoration]:
    """Return the values to write to all servos of the passport, or to one servo, without writing them.

    Raises PassportError.
    """
    wanted = _asked_for(passport, servo_id)
    answers = {answer.servo_id: answer for answer in who_answers(bus)}
    problems: list[str] = []
    plans: list[Restoration] = []
    for number in wanted:
        try:
            _require_clear(answers, number)
            plans.append(_restoration(bus, passport, number, number))
        except (PassportError, ServoError) as error:
            problems.append(str(error))
    _refuse(problems)
    return [plan for plan in plans if plan.values]


def plan_replacement(bus: Bus, passport: Passport, servo_id: int) -> Restoration:
    """Return the values that make a new servo a replacement for ``servo_id`` in the passport. Raises PassportError.

    The new servo may have any ID if it is alone on the bus. Otherwise, the new servo must be the only servo whose ID is
    not in the passport.
    """
    _asked_for(passport, servo_id)
    answers = {answer.servo_id: answer for answer in who_answers(bus)}
    try:
        for number in answers:
            _require_clear(answers, number)
        new_id = _newcomer(bus, list(answers), passport, servo_id)
        return _restoration(bus, passport, servo_id, new_id)
    except (PassportError, ServoError) as error:
        raise PassportError(f"{error}; nothing was written") from error


def restore(bus: Bus, clock: Clock, plan: Restoration) -> tuple[Change, ...]:
    """Write the values to one servo, restart it and check the values. Return the changes.

    Raises ServoError, PortLost.
    """
    return provision(bus, clock, plan.servo_id, plan.model, plan.values)


def restore_all(bus: Bus, clock: Clock, plans: Sequence[Restoration]) -> dict[int, tuple[Change, ...]]:
    """Restore several servos, one after the other.

    Return the changes, keyed by ID. The notes of the exception list the servos already written and the remaining
    servos.
    """
    changes: dict[int, tuple[Change, ...]] = {}
    for index, plan in enumerate(plans):
        try:
            changes[plan.servo_id] = restore(bus, clock, plan)
        except BaseException as error:
            for servo_id, made in changes.items():
                error.add_note(f"already written to servo {servo_id}: {', '.join(map(str, made))}")
            if left := plans[index + 1 :]:
                error.add_note(f"not yet written: servo {', '.join(str(one.servo_id) for one in left)}")
            raise
    return changes


def _asked_for(passport: Passport, servo_id: int | None) -> list[int]:
    if servo_id is None:
        return list(passport.servos)
    if servo_id not in passport.servos:
        known = ", ".join(map(str, passport.servos))
        raise PassportError(f"servo {servo_id} is not in the passport, which contains {known}; nothing was written")
    return [servo_id]


def _newcomer(bus: Bus, present: Sequence[int], passport: Passport, servo_id: int) -> int:
    if not present:
        raise PassportError(
            f"no servo responds on {bus.name} at {bus.baud} baud. Check the power and the baud rate of the servo"
        )
    if len(present) == 1:
        return present[0]
    if servo_id in present:
        raise PassportError(f"a servo already responds to ID {servo_id}. Connect only the new servo")
    strangers = [number for number in present if number not in passport.servos]
    if len(strangers) != 1:
        present_ids = ", ".join(map(str, present))
        raise PassportError(
            f"servos {present_ids} respond, so it is unclear which is the new servo. Connect only the new servo"
        )
    return strangers[0]


def _require_clear(answers: Mapping[int, Answer], servo_id: int) -> None:
    if servo_id not in answers:
        raise PassportError(f"servo {servo_id} does not respond: check its cable and supply")
    if not answers[servo_id].clear:
        raise PassportError(
            f"servo {servo_id}: all replies are corrupted, so probably two servos have this ID. Connect only one"
        )


def _restoration(bus: Bus, passport: Passport, servo_id: int, now_id: int) -> Restoration:
    """Return the values that make the servo ``now_id`` a copy of the servo ``servo_id`` in the passport."""
    servo = passport.servos[servo_id]
    require_model(bus, now_id, servo.servo_model)
    if drives(bus, now_id, servo.servo_model):
        raise PassportError(f"{torque_warning([f'servo {now_id}'])}: support the arm and disable its torque first")
    registers = persistent_registers(servo.servo_model)
    values, now = {}, {}
    for difference in servo_differences(bus, now_id, servo):
        register = registers[difference.register]
        if register.access is Access.READ or register.name in NOT_WRITTEN:
            continue
        if ANSWERS_NO_READ.get(register.name) == difference.saved:
            raise PassportError(
                f"servo {servo_id} would no longer respond if {register.name} were {difference.saved}. Change this "
                f"value in the passport"
            )
        values[register], now[register.name] = difference.saved, difference.now
    return Restoration(now_id, servo.servo_model, values, now)


def _refuse(problems: Sequence[str]) -> None:
    if problems:
        raise PassportError("\n".join([*problems, "nothing was written"]))
