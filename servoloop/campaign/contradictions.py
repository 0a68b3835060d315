"""Find the elements of a scenario or a schedule that are impossible."""

from collections.abc import Iterator, Mapping
from random import Random

from controller.forward.commands import ForwardParameters
from controller.forward.forward_command_controller import ForwardCommandController
from controller.trajectory.parameters import TrajectoryParameters
from drivers.servos.catalog import series_of
from hal.hal_errors import HalError
from hal.types import JointLimits
from pick_place.settings import normal_grade
from servoloop.campaign.draws.clients import draw_client
from servoloop.campaign.promises import PromisedVisit
from servoloop.campaign.scenario import Scenario
from servoloop.campaign.visits import JOB, NO_SERVO, makes_of
from servoloop.simulation.acts import Act
from servoloop.simulation.faulty_stack import number_of_arm
from servoloop.simulation.job import require_cell
from servoloop.simulation.schedule import Schedule
from servoloop.simulation.stack_faults import inventory_of
from servoloop.stack.arm_folders import find_arm
from servoloop.stack.pick_place import load_pick_place
from servoloop.stack.robot_files import Files
from sim_backend.faults.draw import TRIES, impossible
from sim_backend.faults.events import KINDS
from sim_backend.faults.fault_error import FaultError

Mistake = tuple[tuple[str | int, ...], str]
"""Key path of an error in its file, and a sentence that describes the error."""
SEEDS, SEEDS_S = 20, 30.0
"""Number of clients of each type that are drawn to find the possible actions, and the duration of each client in
seconds."""


def in_scenario(scenario: Scenario, arms: Mapping[str, Files]) -> Iterator[Mistake]:
    """Yield the elements of a scenario that are impossible for its arms, clients and faults."""
    for n, (arm, files) in enumerate(arms.items()):
        yield from _in_jobs(scenario.job, arm, files, scenario.place_of(n))
        there = inventory_of(files)
        for k, kind in enumerate(scenario.kinds or ()):
            if why := impossible(kind, there):
                yield ("kinds", k), f"{arm} cannot have {kind!r}: {why}"
    for n, visit in enumerate(scenario.promises.visits):
        if never := _never(visit, scenario, list(arms.values())):
            yield ("promises", "visits", n, never[0]), f"{never[1]}: change the scenario or remove the promise"


def in_schedule(schedule: Schedule, files: Files) -> Iterator[Mistake]:
    """Yield the elements of a schedule that are impossible for its arm, except for impossible faults."""
    yield from _in_jobs(schedule.job, schedule.arm, files, ("arm",))
    joints, hand = joints_and_hand(files, schedule.seed)
    yield from _in_limits(schedule.limits, files)
    for n, act in enumerate(schedule.clients):
        known = ", ".join(joints)
        for *place, name in _named(act):
            if name not in joints:
                yield ("clients", n, *place, name), f"the arm has no joint {name!r}: choose one of {known}"
                break
        if (joint := getattr(act, "joint", None)) is not None and joint not in joints:
            yield ("clients", n, "joint"), f"the arm has no joint {joint!r}: choose one of {known}"
        if act.kind in ("hand", "grip") and not hand:
            yield ("clients", n), "the arm has no hand: remove this act"


def _in_limits(limits: Mapping[str, tuple[float, float]], files: Files) -> Iterator[Mistake]:
    """Yield the narrower limits that conflict with the arm's robot file."""
    park = files.robot.file.park.pose if files.robot.file.park else {}
    for name, (lower, upper) in limits.items():
        if name not in files.robot.limits():
            yield ("limits", name), f"the arm has no joint {name!r}: choose one of {', '.join(files.robot.limits())}"
        elif not files.limits[name].lower <= lower < upper <= files.limits[name].upper:
            widest = f"{files.limits[name].lower:g} to {files.limits[name].upper:g}"
            yield ("limits", name), f"{lower:g} to {upper:g} is not a range within the limits of {name}, {widest}"
        elif name in park and not lower <= park[name] <= upper:
            yield (
                ("limits", name),
                f"{name} parks at {park[name]:g}, outside {lower:g} to {upper:g}: widen the range",
            )


def _named(act: Act) -> Iterator[tuple[str | int, ...]]:
    """Yield the key path of each joint name in the positions and points of an action."""
    yield from (("positions", name) for name in getattr(act, "positions", ()))
    yield from (("points", n, name) for n, point in enumerate(getattr(act, "points", ())) for name in point)


def joints_and_hand(files: Files, seed: int | None) -> tuple[dict[str, JointLimits], bool]:
    """Return the joints of the arm that a seed's clients move, with their limits, and whether the arm has a hand."""
    parameters = (spec.parameters for spec in files.controllers.controllers)
    arms = [one for one in parameters if isinstance(one, TrajectoryParameters)]
    joints = arms[number_of_arm(seed, len(arms))].joints if arms else ()
    return {joint: files.limits[joint] for joint in joints}, bool(hand_of(files))


def hand_of(files: Files) -> str:
    """Return the joint that gripper goals move, or an empty string if the arm has no hand."""
    hands = (spec.parameters for spec in files.controllers.controllers if spec.kind == ForwardCommandController.kind)
    hand = next(hands, None)
    return hand.joints[0] if isinstance(hand, ForwardParameters) else ""


def _in_jobs(job: tuple[str, ...], arm: str, files: Files, place: tuple[str | int, ...]) -> Iterator[Mistake]:
    """Yield an error for each job that the arm cannot perform."""
    if not job:
        return
    try:
        require_cell(files, job)
        known = load_pick_place(find_arm(arm).pick_place).grades
    except HalError as error:
        yield place, f"{arm} cannot run jobs: {error}"
        return
    for n, grade in enumerate(job):
        if normal_grade(grade) not in known:
            yield ("job", n), f"{arm} has no bin for the grade {grade!r}: choose one of {', '.join(known)}"


def _never(visit: PromisedVisit, scenario: Scenario, arms: list[Files]) -> tuple[str, str] | None:
    """Return the key and the reason if this visit is impossible in every run of the scenario, or None if it is
    possible."""
    kinds = KINDS if scenario.kinds is None else scenario.kinds
    if scenario.faults == 0:
        return "fault", "`faults` is 0, but every visit needs a fault"
    if visit.fault is not None and visit.fault not in kinds:
        return "fault", f"no run has the fault {visit.fault!r}, because `kinds` does not include it"
    makes = {make for files in arms for make in _makes(visit.fault, files)}
    if not makes:
        why = impossible(visit.fault or "", inventory_of(arms[-1]))
        return "fault", f"no arm of the scenario can have {visit.fault!r} ({why})"
    if visit.make not in {None, *makes}:
        fault = "a fault" if visit.fault is None else repr(visit.fault)
        return "make", f"{fault} cannot affect the make {visit.make!r}, only {', '.join(sorted(makes))}"
    acts = {act for kind in scenario.clients for files in arms for act in _acts(kind, files)}
    if visit.client not in {None, *acts}:
        return "client", f"no client of the scenario does {visit.client!r}, only {', '.join(sorted(acts))}"
    return None


def _makes(kind: str | None, files: Files) -> set[str]:
    """Return the makes of the servos that a fault type can affect; None means all fault types."""
    if kind is None:
        return {series_of(joint.model).make for joint in files.robot.joints} | {NO_SERVO}
    there, makes = inventory_of(files), set[str]()
    for number in range(TRIES):
        try:
            makes |= makes_of(KINDS[kind].drawn(Random(f"{kind}/{number}"), there, 0.0), files.robot.joints)
        except FaultError:
            continue
    return makes


def _acts(kind: str, files: Files) -> set[str]:
    """Return the types of actions that a type of client performs."""
    arm = joints_and_hand(files, None)
    return {JOB, *(act.kind for seed in range(SEEDS) for act in draw_client(kind, seed, *arm, SEEDS_S))}
