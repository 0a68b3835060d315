"""Set up the servos of an arm, connected one after the other. Servos that have already been set up are recognized."""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from math import degrees
from typing import Final, Literal, Protocol

from commissioning.provision import provision
from commissioning.registers.tables import rates_of
from commissioning.scan.answers import Answer, who_answers
from commissioning.set_up.only_one import (
    FACTORY_ID,
    NotYet,
    ServoPlace,
    SetUpError,
    bring_to_rate,
    in_order,
    only_servo,
    require_fit,
    voltage,
)
from commissioning.set_up.turn import WAY_RAD, GearResult, judge_gear, may_hold_text, rivals, turn_loose
from drivers.bus.bus import Bus
from drivers.clock import Clock
from drivers.driver_errors import ServoError
from drivers.eeprom import Change
from drivers.printable import counted

TRIES: Final = 10
"""Maximum number of times that the user is asked to do one task."""


@dataclass(frozen=True, slots=True)
class SetUpTask:
    """A task for the person who connects the servos."""

    kind: Literal["one", "chain"]
    """Whether to connect only one servo or the whole chain."""
    text: str
    """Instruction for the user."""
    joint: str = ""
    problem: str = ""
    """Reason why the task is repeated; empty at the first attempt."""


class SetUpDialog(Protocol):
    """Interface to the person who connects the servos, or to a script in a test."""

    def connect(self, task: SetUpTask) -> None:
        """Return when the task is done."""
        ...

    def say(self, text: str) -> None:
        """Show a message that needs no answer."""
        ...


@dataclass(frozen=True, slots=True)
class Audit:
    """One servo after its set-up, as it responds in the chain."""

    joint: str
    servo_id: int
    model: str
    voltage_v: float
    changes: tuple[Change, ...]
    """Changes written to the servo in this run."""
    from_id: int | None
    """ID before the set-up; None if the servo had already been set up."""
    from_baud: int | None
    """Baud rate before the set-up; None if it was not changed."""
    gear: GearResult | None = None
    """Result of the gear test; None if the gear was not tested in this run."""


@dataclass(frozen=True, slots=True)
class _Made:
    """Changes made to one servo in this run."""

    changes: tuple[Change, ...] = ()
    from_id: int | None = None
    from_baud: int | None = None
    gear: GearResult | None = None


class SetUp:
    """Set-up of all servos on one bus.

    At the end, even after an error, the EEPROM is locked and the torque state is unchanged, except for a servo that
    ``torque_left`` names.
    """

    def __init__(
        self,
        bus: Bus,
        clock: Clock,
        places: Sequence[ServoPlace],
        guide: SetUpDialog,
        *,
        turn: bool = False,
        stopped: Callable[[], bool] = lambda: False,
    ) -> None:
        """Prepare the set-up.

        Args:
            bus: Bus of the servos.
            clock: Clock for all delays and timeouts.
            places: Servos of the arm.
            guide: Interface to the person who connects the servos.
            turn: Whether servos turn their horns to identify their gears if several models share their model number.
                Otherwise, torque is never enabled.
            stopped: Function that is called while a horn is turning. When this function returns True, StoppedError is
                raised.
        """
        self.torque_left = ""
        """Warning about the last servo that was turned, if its torque may still be on; otherwise, an empty string."""
        self._turn = turn
        self._stopped = stopped
        self._bus = bus
        self._clock = clock
        self._places = tuple(places)
        self._guide = guide
        self._made: dict[str, _Made] = {}

    @property
    def done(self) -> tuple[str, ...]:
        """Joints whose servos have been set up."""
        return tuple(self._made)

    def run(self) -> list[Audit]:
        """Guide the user through all servos, and then check the whole chain. Return the result for each servo.

        Raises SetUpError, ServoError, PortLost.
        """
        self._recognise()
        for place in in_order(self._places):
            if place.joint not in self._made:
                self._one(place)
        audit = self._chain()
        self._report_unknown_gears()
        return audit

    def _recognise(self) -> None:
        """Find the servos that have already been set up. A factory ID is accepted only if all other servos are set
        up."""
        answers = {answer.servo_id: answer for answer in who_answers(self._bus)}
        for place in in_order(self._places):
            whole = len(self._made) == len(self._places) - 1
            if (place.servo_id != FACTORY_ID or whole) and self._is_as_wanted(place, answers):
                self._made[place.joint] = _Made()
                self._guide.say(f"{place.joint}: servo {place.servo_id} is already set up")

    def _is_as_wanted(self, place: ServoPlace, answers: Mapping[int, Answer]) -> bool:
        if place.servo_id not in answers or not answers[place.servo_id].clear:
            return False
        try:
            require_fit(self._bus, place.servo_id, place, self._places)
            return not place.differs(self._bus, place.servo_id)
        except (NotYet, ServoError):
            return False

    def _one(self, place: ServoPlace) -> None:
        """Ask the user to connect one servo, and set up that servo for this joint."""
        text, problem = f"Connect only the servo for {place.joint}. It gets ID {place.servo_id}", ""
        if self._turns(place):
            text += (
                f". Its horn will turn by up to {degrees(WAY_RAD):.0f} degrees and back, so keep it free (Ctrl-C stops "
                "it)"
            )
        for _ in range(TRIES):
            self._guide.connect(SetUpTask("one", text, place.joint, problem))
            try:
                self._made[place.joint] = self._set_up(place)
                return
            except (NotYet, ServoError) as error:  # Values already written are recognized at the next attempt.
                problem = "\n".join([str(error), *getattr(error, "__notes__", [])])
        raise SetUpError(f"{place.joint}: {problem}")

    def _set_up(self, place: ServoPlace) -> _Made:
        answer = only_servo(self._bus, list(rates_of(place.model).values()))
        if answer.baud == self._bus.baud:
            require_fit(self._bus, answer.servo_id, place, self._places)
        else:
            with self._bus.at_baud(answer.baud) as other:
                require_fit(other, answer.servo_id, place, self._places)
            bring_to_rate(self._bus, self._clock, answer.servo_id, place.model, answer.baud)
        changes: tuple[Change, ...] = ()
        gear: GearResult | None = None
        if self._turns(place):
            changes = provision(self._bus, self._clock, answer.servo_id, place.model, place.basics())
            gear = self._gear(place, answer.servo_id)
        changes += provision(self._bus, self._clock, answer.servo_id, place.model, place.wanted())
        done = f"{counted(len(changes), 'register')} written and checked" if changes else "no changes needed"
        self._guide.say(f"{place.joint}: servo {place.servo_id} is set up ({done})")
        return _Made(changes, answer.servo_id, None if answer.baud == self._bus.baud else answer.baud, gear)

    def _turns(self, place: ServoPlace) -> bool:
        return self._turn and bool(rivals(place.model))

    def _gear(self, place: ServoPlace, servo_id: int) -> GearResult:
        """Turn the horn of the servo to test its gear. Raises NotYet if the servo has the wrong gear."""
        self._guide.say(f"{place.joint}: the horn of servo {servo_id} turns now")
        try:
            motion = turn_loose(self._bus, self._clock, servo_id, place, self._stopped)
        except BaseException as error:
            warning = may_hold_text(servo_id)
            self.torque_left = warning if warning in (str(error), *getattr(error, "__notes__", ())) else ""
            raise
        self.torque_left = ""
        gear = judge_gear(motion)
        if gear.verdict == "other":
            anew = servo_id == place.servo_id != FACTORY_ID
            advice = (
                f"To use this servo for another joint, reset it with 'servoloop factory-reset {servo_id} --port "
                f"{self._bus.name}' and 'servoloop set-id {servo_id} {FACTORY_ID} --port {self._bus.name}'"
            )
            raise NotYet(
                f"servo {servo_id} has the wrong gear for {place.joint}: {gear.text}. Connect the right servo. "
                + (advice if anew else "You can still use this servo for another joint")
            )
        verdict = "its gear is right" if gear.verdict == "fits" else "its gear could not be determined"
        self._guide.say(f"{place.joint}: {verdict} ({gear.text})")
        return gear

    def _report_unknown_gears(self) -> None:
        """Report the servos whose gears could not be identified."""
        looks = {place.joint: self._made[place.joint].gear for place in self._places if rivals(place.model)}
        unknown = [joint for joint, gear in looks.items() if gear is None or gear.verdict != "fits"]
        if unknown:
            self._guide.say(
                f"the gears of {', '.join(unknown)} are unknown, because models with different gears have the same "
                "model number. Test the gears of single servos with 'servoloop setup --turn', and those of an "
                "assembled arm with 'servoloop doctor --move'"
            )

    def _chain(self) -> list[Audit]:
        """Ask the user to connect all servos, and check that each servo responds with the right values."""
        text, problem = f"Connect all {len(self._places)} servos in a chain", ""
        problems = self._complaints()
        for _ in range(TRIES):
            if not problems:
                return [self._audit(place) for place in self._places]
            self._guide.connect(SetUpTask("chain", text, "", problem))
            problem = "\n".join(problems := self._complaints())
        raise SetUpError(problem)

    def _complaints(self) -> list[str]:
        answers = {answer.servo_id: answer for answer in who_answers(self._bus)}
        known = {place.servo_id for place in self._places}
        problems = [
            f"a servo with ID {i} responds, but the robot file does not contain it: remove the servo"
            for i in answers
            if i not in known
        ]
        for place in self._places:
            if complaint := self._complaint(place, answers.get(place.servo_id)):
                problems.append(f"{place.joint} (servo {place.servo_id}) {complaint}")
        return problems

    def _complaint(self, place: ServoPlace, answer: Answer | None) -> str:
        if answer is None:
            return "does not respond: check its cable"
        if not answer.clear:
            return "sends only corrupted replies: probably two servos have this ID"
        try:
            differs = place.differs(self._bus, place.servo_id)
        except ServoError as error:
            return error.text
        return f"did not keep the values that were written to {', '.join(differs)}" if differs else ""

    def _audit(self, place: ServoPlace) -> Audit:
        made = self._made[place.joint]
        volts = voltage(self._bus, place.servo_id)
        return Audit(
            place.joint, place.servo_id, place.model.name, volts, made.changes, made.from_id, made.from_baud, made.gear
        )
