"""The set-up of an arm's servos, one connected after the other; whatever was done before is recognised."""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from math import degrees
from typing import Final, Literal, Protocol

from calibration.eeprom import Change
from commissioning.provision import provision
from commissioning.registers.tables import rates_of
from commissioning.scan.answers import Answer, who_answers
from commissioning.set_up.only_one import (
    FACTORY_ID,
    NotYet,
    Place,
    SetUpError,
    bring_to_rate,
    in_order,
    only_servo,
    require_fit,
    voltage,
)
from commissioning.set_up.turn import WAY_RAD, GearLook, judge_gear, rivals, turn_loose
from drivers.bus.bus import Bus
from drivers.clock import Clock
from drivers.errors import ServoError
from drivers.printable import counted

TRIES: Final = 10
"""So often the user is asked for the same thing."""


@dataclass(frozen=True, slots=True)
class Task:
    """What is to be connected: ``text`` for people; ``kind`` and ``joint`` for programs."""

    kind: Literal["one", "chain"]
    text: str
    joint: str = ""
    problem: str = ""
    """Why it is asked again; empty the first time."""


class Guide(Protocol):
    """Whoever plugs servos in: a person at a terminal, or a test's script with a virtual box."""

    def connect(self, task: Task) -> None:
        """Have it connected; return when it is."""
        ...

    def say(self, text: str) -> None:
        """Tell something that needs no answer."""
        ...


@dataclass(frozen=True, slots=True)
class Audit:
    """One servo behind its set-up, as it answers in the chain."""

    joint: str
    servo_id: int
    model: str
    voltage_v: float
    changes: tuple[Change, ...]
    """What was written to it in this run."""
    from_id: int | None
    """The ID that it had when it was connected; None where it was found set up."""
    from_baud: int | None
    gear: GearLook | None = None
    """What its turn has shown; None where it was not turned in this run."""


@dataclass(frozen=True, slots=True)
class _Made:
    """What was done to one servo in this run."""

    changes: tuple[Change, ...] = ()
    from_id: int | None = None
    from_baud: int | None = None
    gear: GearLook | None = None


class SetUp:
    """The set-up of all servos on one line. The EEPROM is locked whenever it ends, and torque as it was."""

    def __init__(
        self,
        bus: Bus,
        clock: Clock,
        places: Sequence[Place],
        guide: Guide,
        *,
        turn: bool = False,
        stopped: Callable[[], bool] = lambda: False,
    ) -> None:
        """``turn``: each single servo whose model's number is that of others too turns its horn, which tells its gear;
        otherwise torque is never switched. ``stopped`` is asked meanwhile: once it says yes, StoppedError is raised.
        """
        self.turn = turn
        self._stopped = stopped
        self._bus = bus
        self._clock = clock
        self._places = tuple(places)
        self._guide = guide
        self._made: dict[str, _Made] = {}

    @property
    def done(self) -> tuple[str, ...]:
        """The joints whose servos are set up."""
        return tuple(self._made)

    def run(self) -> list[Audit]:
        """Have every servo connected and set up, then the chain. Raises SetUpError, ServoError, PortLost."""
        self._recognise()
        for place in in_order(self._places):
            if place.joint not in self._made:
                self._one(place)
        audit = self._chain()
        self._say_whose_gear_is_unknown()
        return audit

    def _recognise(self) -> None:
        """Note the servos that answer and are as they shall be. A factory ID proves nothing but in a whole chain."""
        answers = {answer.servo_id: answer for answer in who_answers(self._bus)}
        for place in in_order(self._places):
            whole = len(self._made) == len(self._places) - 1
            if (place.servo_id != FACTORY_ID or whole) and self._is_as_wanted(place, answers):
                self._made[place.joint] = _Made()
                self._guide.say(f"{place.joint}: servo {place.servo_id} is set up already")

    def _is_as_wanted(self, place: Place, answers: Mapping[int, Answer]) -> bool:
        if place.servo_id not in answers or not answers[place.servo_id].clear:
            return False
        try:
            require_fit(self._bus, place.servo_id, place, self._places)
            return not place.differs(self._bus, place.servo_id)
        except (NotYet, ServoError):
            return False

    def _one(self, place: Place) -> None:
        """Have one servo connected, and make it the place's."""
        text, problem = f"Connect only the servo of {place.joint} (it becomes servo {place.servo_id})", ""
        if self._turns(place):
            text += (
                f"; its horn will turn by up to {degrees(WAY_RAD):.0f} degrees and back (Ctrl-C stops it): have it free"
            )
        for _ in range(TRIES):
            self._guide.connect(Task("one", text, place.joint, problem))
            try:
                self._made[place.joint] = self._set_up(place)
                return
            except (NotYet, ServoError) as error:  # nothing is lost: what was written is recognised
                problem = "\n".join([str(error), *getattr(error, "__notes__", [])])
        raise SetUpError(f"{place.joint}: {problem}")

    def _set_up(self, place: Place) -> _Made:
        answer = only_servo(self._bus, list(rates_of(place.model).values()))
        if answer.baud == self._bus.baud:
            require_fit(self._bus, answer.servo_id, place, self._places)
        else:
            with self._bus.at_baud(answer.baud) as other:
                require_fit(other, answer.servo_id, place, self._places)
            bring_to_rate(self._bus, self._clock, answer.servo_id, place.model, answer.baud)
        changes: tuple[Change, ...] = ()
        gear: GearLook | None = None
        if self._turns(place):
            changes = provision(self._bus, self._clock, answer.servo_id, place.model, place.basics())
            gear = self._gear(place, answer.servo_id)
        changes += provision(self._bus, self._clock, answer.servo_id, place.model, place.wanted())
        what = f"{counted(len(changes), 'register')} written, read back, locked" if changes else "nothing to write"
        self._guide.say(f"{place.joint}: servo {place.servo_id}, {what}")
        return _Made(changes, answer.servo_id, None if answer.baud == self._bus.baud else answer.baud, gear)

    def _turns(self, place: Place) -> bool:
        return self.turn and bool(rivals(place.model))

    def _gear(self, place: Place, servo_id: int) -> GearLook:
        """Have the servo turn its horn; a servo of another gear gets neither the joint's settings nor its ID."""
        self._guide.say(f"{place.joint}: the horn of servo {servo_id} turns")
        gear = judge_gear(turn_loose(self._bus, self._clock, servo_id, place, self._stopped))
        if gear.verdict == "other":
            anew = servo_id == place.servo_id != FACTORY_ID
            left = (
                f"'servoloop factory-reset {servo_id}' and 'servoloop set-id {servo_id} {FACTORY_ID}' make this one new"
            )
            raise NotYet(
                f"servo {servo_id} has another gear than {place.joint} is to have: {gear.text}. Connect the right one; "
                + (left if anew else "this one can still become any other joint's")
            )
        said = "its gear fits" if gear.verdict == "fits" else "its gear cannot be told"
        self._guide.say(f"{place.joint}: {said}: {gear.text}")
        return gear

    def _say_whose_gear_is_unknown(self) -> None:
        """Say in one line of which servos nobody knows whether they have their model's gear."""
        looks = {place.joint: self._made[place.joint].gear for place in self._places if rivals(place.model)}
        unknown = [joint for joint, gear in looks.items() if gear is None or gear.verdict != "fits"]
        if unknown:
            self._guide.say(
                f"the gears of {', '.join(unknown)} are not known, for models with other gears say the same number: "
                "'servoloop setup --turn' tells those of single servos, 'servoloop doctor --move' those of an arm"
            )

    def _chain(self) -> list[Audit]:
        """Have all connected, and see that each answers and holds what it shall."""
        text, problem = f"Connect all {len(self._places)} servos in a chain", ""
        problems = self._complaints()
        for _ in range(TRIES):
            if not problems:
                return [self._audit(place) for place in self._places]
            self._guide.connect(Task("chain", text, "", problem))
            problem = "\n".join(problems := self._complaints())
        raise SetUpError(problem)

    def _complaints(self) -> list[str]:
        answers = {answer.servo_id: answer for answer in who_answers(self._bus)}
        known = {place.servo_id for place in self._places}
        problems = [f"servo {i} answers, and the robot file has none with this ID" for i in answers if i not in known]
        for place in self._places:
            if complaint := self._complaint(place, answers.get(place.servo_id)):
                problems.append(f"{place.joint} (servo {place.servo_id}) {complaint}")
        return problems

    def _complaint(self, place: Place, answer: Answer | None) -> str:
        if answer is None:
            return "does not answer"
        if not answer.clear:
            return "never answers in one piece: do two servos have this ID?"
        try:
            differs = place.differs(self._bus, place.servo_id)
        except ServoError as error:
            return error.text
        return f"does not hold what was written: {', '.join(differs)}" if differs else ""

    def _audit(self, place: Place) -> Audit:
        made = self._made[place.joint]
        volts = voltage(self._bus, place.servo_id)
        return Audit(
            place.joint, place.servo_id, place.model.name, volts, made.changes, made.from_id, made.from_baud, made.gear
        )
