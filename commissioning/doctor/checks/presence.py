"""Check which servos are on a bus: missing or unexpected servos, duplicate IDs, and wrong baud rates."""

from collections.abc import Iterator, Sequence

from commissioning.doctor.findings import Finding, FindingPlace, finding
from commissioning.doctor.snapshot import ArmSnapshot, BusSnapshot, ServoSnapshot, Stranger, on, write
from drivers.servos.catalog import series_of
from drivers.servos.x import PAIRS

FACTORY_ID = 1


def place_of(bus: BusSnapshot, servo: ServoSnapshot) -> FindingPlace:
    """Return the place of a servo, for use in a finding."""
    return FindingPlace(bus.name, servo.joint.name, servo.joint.servo_id)


def check_presence(snapshot: ArmSnapshot) -> Iterator[Finding]:
    """Check every bus that could be opened."""
    for bus in snapshot.buses:
        silent = [servo for servo in bus.servos if servo.heard == "silent"]
        yield from _together(bus, silent)
        yield from (_silent(bus, servo) for servo in silent)
        yield from _doubtful(bus)
        yield from _group_reads(bus)
        yield from _strangers(bus, silent)


def _together(bus: BusSnapshot, silent: Sequence[ServoSnapshot]) -> Iterator[Finding]:
    """Find a common cause for several silent servos."""
    place, rates = FindingPlace(bus=bus.name), {servo.elsewhere_baud for servo in silent}
    all_silent = len(silent) == len(bus.servos) and bool(silent)
    if all_silent and rates == {None} and not bus.strangers:
        yield finding(
            "no_power",
            place,
            "no servo responds: 'there is no status packet'",
            "No servo responds at any baud rate, so the servos probably have no power. Check the supply with its "
            "switch and plug, the first cable, and the adapter's jumper, which must connect USB to the servos (B on "
            "a Waveshare board)",
            f"servoloop scan {bus.port}",
        )
    elif all_silent and len(rates) == 1 and None not in rates:
        (baud,) = rates
        cause = (
            f"All servos respond at {baud} baud, but the robot file has {bus.baud}. Set baud: {baud} in the robot file"
        )
        yield finding("wrong_rate", place, "no servo responds: 'there is no status packet'", cause)
    behind = _behind_a_break(bus, silent)
    if behind:
        names = ", ".join(f"{servo.joint.name} ({servo.joint.servo_id})" for servo in behind)
        last = bus.servos[len(bus.servos) - len(behind) - 1].joint
        cause = (
            f"{names} do not respond, but all servos before them do. If the servos are daisy-chained in this order, "
            f"the cable after {last.name} (servo {last.servo_id}) is loose or broken"
        )
        yield finding("chain_broken", place, "missing motor IDs: the last servos do not respond", cause)


def _behind_a_break(bus: BusSnapshot, silent: Sequence[ServoSnapshot]) -> Sequence[ServoSnapshot]:
    """Return the servos after a break in the chain, if at least two servos at the end of the bus are missing."""
    nowhere = [servo for servo in silent if servo.elsewhere_baud is None]
    if 1 < len(nowhere) < len(bus.servos) and list(bus.servos[-len(nowhere) :]) == nowhere:
        return nowhere
    return ()


def _silent(bus: BusSnapshot, servo: ServoSnapshot) -> Finding:
    servo_id, baud = servo.joint.servo_id, servo.elsewhere_baud
    symptom = f"missing motor ID {servo_id}"
    if baud is not None:
        cause = f"The servo responds at {baud} baud, but the bus runs at {bus.baud}. Change the baud rate of the servo"
        command = on(bus.port, "set-baud", servo_id, bus.baud)
        return finding("servo_other_rate", place_of(bus, servo), symptom, cause, command)
    cause = (
        f"No servo with ID {servo_id} responds at any baud rate. Check its cable, plugs and supply. If they are good, "
        "the servo may have another ID: connect it alone and scan the port"
    )
    if servo.joint.model in PAIRS:
        cause += (
            f". A {servo.joint.model.name} is two servos in one case with one cable, and each has its own ID: if the "
            "other servo in the case responds, only this ID is wrong"
        )
    return finding("servo_absent", place_of(bus, servo), symptom, cause, f"servoloop scan {bus.port}")


def _doubtful(bus: BusSnapshot) -> Iterator[Finding]:
    """Find servos that reply with errors."""
    for servo in bus.servos:
        servo_id, place = servo.joint.servo_id, place_of(bus, servo)
        if servo.heard == "broken":
            cause = (
                f"Every reply from this ID is corrupted. Probably two servos have ID {servo_id} (all new servos "
                f"have ID {FACTORY_ID}). Connect one of them alone and give it another ID. If only one servo has "
                "this ID, check its plugs"
            )
            command = on(bus.port, "set-id", servo_id, "NEW")
            yield finding("same_id", place, f"'incorrect status packet' from ID {servo_id}", cause, command)
        elif servo.heard == "mute":
            symptom = f"missing motor ID {servo_id}, although a scan finds it"
            yield finding("servo_mute", place, symptom, *_mute(servo))
        elif servo.heard == "late":
            cause = (
                "The replies arrive after the next request, because the adapter or a USB hub delays them. Check the "
                "adapter, and plug it directly into the computer"
            )
            yield finding("servo_late", place, "occasional read timeouts", cause, "servoloop ports")
        elif servo.heard == "unsteady":
            cause = (
                "The servo responds only to some requests. Check for a loose plug, a bad cable, or a supply that "
                "fails under load"
            )
            yield finding("servo_unsteady", place, f"ID {servo_id} is missing from time to time", cause)


def _mute(servo: ServoSnapshot) -> tuple[str, str | None]:
    """Return the cause and the command for a servo that responds to pings but not to reads."""
    model = servo.joint.model
    series = series_of(model)
    level = series.status_level
    if series.make == "feetech":
        return (
            "The servo responds to pings but not to reads of its state. Switch its supply off and on. If this does not "
            f"help, check that it is an {model.name} as in the robot file. If it is, replace the servo"
        ), None
    named = (
        f"The servo responds to pings but not to reads, so its {level.name} (register {level.address}) is probably 0"
    )
    also = "" if level.persistent else ", or switch its supply off and on, because this register is in RAM"
    command = f"{write(servo, level.name, series.answers_all)} --model {model.name}"
    return f"{named}. Write {series.answers_all} to this register{also}", command


def _group_reads(bus: BusSnapshot) -> Iterator[Finding]:
    """Find servos that respond only to single reads."""
    for servo in bus.servos:
        if servo.alone:
            level = series_of(servo.joint.model).status_level
            cause = (
                f"The servo responds to single reads, but not to group reads (sync read). Its {level.name} (register "
                f"{level.address}) is {servo.registers.get(level.name, 'unknown')}, so this is not a setting: its "
                f"firmware lacks the instruction, as in many self-made servos. servoloop reads and writes it with "
                "single requests; the log of servoloop up states the highest possible rate"
            )
            yield finding(
                "no_group_reads", place_of(bus, servo), "each cycle takes longer than with other servos", cause
            )


def _strangers(bus: BusSnapshot, silent: Sequence[ServoSnapshot]) -> Iterator[Finding]:
    for stranger in bus.strangers:
        place = FindingPlace(bus.name, None, stranger.servo_id)
        if len(silent) == 1 and silent[0].elsewhere_baud is None and _fits(stranger, silent[0]):
            servo = silent[0]
            wanted = servo.joint.servo_id
            cause = (
                f"No servo has ID {wanted}, but an {stranger.model} with ID {stranger.servo_id} is on the bus and does "
                f"not belong to a joint. It is probably the servo of {servo.joint.name}: set its ID to {wanted}"
            )
            command = on(bus.port, "set-id", stranger.servo_id, wanted)
            yield finding("id_not_set", FindingPlace(bus.name), f"missing motor ID {wanted}", cause, command)
        cause = (
            f"A servo (model {stranger.model or 'unknown'}) responds to an ID that is not in the robot file. Remove "
            "it from the bus, or add it to the robot file"
        )
        yield finding("extra_servo", place, f"an unexpected servo with ID {stranger.servo_id}", cause)


def _fits(stranger: Stranger, servo: ServoSnapshot) -> bool:
    """Return whether the unexpected servo may be the missing servo.

    Variants with different gears or voltages share the same model number.
    """
    return stranger.model is not None and stranger.model.partition("_")[0] == servo.joint.model.name.partition("_")[0]
