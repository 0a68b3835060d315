"""Who is on the line: nobody, some, two with one ID, at another rate, or servos that no joint has."""

from collections.abc import Iterator, Sequence

from commissioning.doctor.findings import Finding, Place, finding
from commissioning.doctor.snapshot import BusSnapshot, ServoSnapshot, Snapshot, Stranger, on

FACTORY_ID = 1


def place_of(bus: BusSnapshot, servo: ServoSnapshot) -> Place:
    """The servo's place."""
    return Place(bus.name, servo.joint.name, servo.joint.servo_id)


def check_presence(snapshot: Snapshot) -> Iterator[Finding]:
    """All buses that could be opened."""
    for bus in snapshot.buses:
        silent = [servo for servo in bus.servos if servo.heard == "silent"]
        yield from _together(bus, silent)
        yield from (_silent(bus, servo) for servo in silent)
        yield from _doubtful(bus)
        yield from _strangers(bus, silent)


def _together(bus: BusSnapshot, silent: Sequence[ServoSnapshot]) -> Iterator[Finding]:
    """What one cause would explain of several that are silent."""
    place, rates = Place(bus=bus.name), {servo.elsewhere_baud for servo in silent}
    nobody = len(silent) == len(bus.servos) and bool(silent)
    if nobody and rates == {None} and not bus.strangers:
        yield finding(
            "no_power",
            place,
            "no servo answers: 'there is no status packet'",
            "no servo answers at any rate, so most likely they have no power: check the supply, its switch and its "
            "plug, the adapter's jumper (servos, not the computer, must be joined to the line: B on a Waveshare board) "
            "and the first cable",
            f"servoloop scan {bus.port}",
        )
    elif nobody and len(rates) == 1 and None not in rates:
        (baud,) = rates
        cause = f"all servos answer at {baud} baud, and the robot file says {bus.baud}: write baud: {baud} into it"
        yield finding("wrong_rate", place, "no servo answers: 'there is no status packet'", cause)
    behind = _behind_a_break(bus, silent)
    if behind:
        names = ", ".join(f"{servo.joint.name} ({servo.joint.servo_id})" for servo in behind)
        last = bus.servos[len(bus.servos) - len(behind) - 1].joint
        cause = (
            f"{names} are silent and all before them answer. If the servos hang one behind the other in this order, "
            f"the cable behind {last.name} (servo {last.servo_id}) is loose or broken"
        )
        yield finding("chain_broken", place, "missing motor IDs: the last servos do not answer", cause)


def _behind_a_break(bus: BusSnapshot, silent: Sequence[ServoSnapshot]) -> Sequence[ServoSnapshot]:
    """The servos behind a break, if those that are nowhere are the last ones, and more than one."""
    nowhere = [servo for servo in silent if servo.elsewhere_baud is None]
    if 1 < len(nowhere) < len(bus.servos) and list(bus.servos[-len(nowhere) :]) == nowhere:
        return nowhere
    return ()


def _silent(bus: BusSnapshot, servo: ServoSnapshot) -> Finding:
    servo_id, baud = servo.joint.servo_id, servo.elsewhere_baud
    symptom = f"missing motor ID {servo_id}"
    if baud is not None:
        cause = f"it answers at {baud} baud, and the bus runs at {bus.baud}"
        command = on(bus.port, "set-baud", servo_id, bus.baud)
        return finding("servo_other_rate", place_of(bus, servo), symptom, cause, command)
    cause = (
        f"it answers at no rate: its cable or plug, its supply, or nobody has ID {servo_id}. Connect it alone to see "
        "which ID it has"
    )
    return finding("servo_absent", place_of(bus, servo), symptom, cause, f"servoloop scan {bus.port}")


def _doubtful(bus: BusSnapshot) -> Iterator[Finding]:
    """Those that say something, and not as they should."""
    for servo in bus.servos:
        servo_id, place = servo.joint.servo_id, place_of(bus, servo)
        if servo.heard == "broken":
            cause = (
                f"it answers, but never in one piece: two servos probably have ID {servo_id} (new ones all have "
                f"{FACTORY_ID}). Connect one of them alone and give it another ID; if there is only one, check "
                "its plugs"
            )
            command = on(bus.port, "set-id", servo_id, "NEW")
            yield finding("same_id", place, f"'incorrect status packet' from ID {servo_id}", cause, command)
        elif servo.heard == "mute":
            cause = "it answers a ping and no read: its status level keeps it from answering"
            yield finding("servo_mute", place, f"missing motor ID {servo_id}, though it is found by a scan", cause,
                          on(bus.port, "factory-reset", servo_id))  # fmt: skip
        elif servo.heard == "late":
            cause = "its replies come after the next question: the adapter or a hub holds them back"
            yield finding("servo_late", place, "reads time out now and then", cause, "servoloop ports")
        elif servo.heard == "unsteady":
            cause = "it answers only now and then: a loose plug, a bad cable, or a supply that breaks down"
            yield finding("servo_unsteady", place, f"ID {servo_id} is missing now and then", cause)


def _strangers(bus: BusSnapshot, silent: Sequence[ServoSnapshot]) -> Iterator[Finding]:
    for stranger in bus.strangers:
        place = Place(bus.name, None, stranger.servo_id)
        if len(silent) == 1 and silent[0].elsewhere_baud is None and _fits(stranger, silent[0]):
            servo = silent[0]
            wanted = servo.joint.servo_id
            cause = (
                f"nobody has ID {wanted}, and a {stranger.model} with ID {stranger.servo_id} is on the line that no "
                f"joint has: it is probably that of {servo.joint.name}"
            )
            command = on(bus.port, "set-id", stranger.servo_id, wanted)
            yield finding("id_not_set", Place(bus.name), f"missing motor ID {wanted}", cause, command)
        cause = (
            f"a {stranger.model or 'servo of an unknown model'} answers to an ID that no joint of the robot file has"
        )
        yield finding("extra_servo", place, f"an unexpected servo with ID {stranger.servo_id}", cause)


def _fits(stranger: Stranger, servo: ServoSnapshot) -> bool:
    """Models with one number (other gears, other voltages) cannot be told apart by it."""
    return stranger.model is not None and stranger.model.partition("_")[0] == servo.joint.model.name.partition("_")[0]
