"""Read and write schedules. A schedule file has all inputs of a simulated run, so that the run can be replayed."""

from pathlib import Path

import yaml
from pydantic import BaseModel, ConfigDict

from drivers.driver_errors import DriverError
from hal.plausible import Backlash, Position, Seed, Time
from hal.robot_file.robot_file import ExitPolicy, FirmwareVersion
from hal.yaml_file import load
from hal.yaml_nodes import compose
from servoloop.simulation.acts import Act, GuideArm, SocketAct
from servoloop.stack.arm_folders import arm_in
from servoloop.stack.shipped_files import OWN
from sim_backend.faults.event import Event
from sim_backend.faults.events import FaultEvent
from sim_backend.faults.script import plain


class ScheduleError(DriverError):
    """Raised when a schedule has errors. The message lists all errors with their line numbers."""


class Schedule(BaseModel):
    """Schedule of one run: arm, jobs, faults and client actions."""

    model_config = ConfigDict(extra="forbid", frozen=True)

    arm: str = OWN
    seed: Seed | None = None
    """Random seed for the arm's friction, motors, masses and supply; None for nominal values."""
    backlash_deg: Backlash = 1.0
    job: tuple[str, ...] = ()
    """Grade of each job."""
    seconds: Time = 0.0
    """Time the arm stays active after its last job, in seconds."""
    faults: tuple[FaultEvent, ...] = ()
    """Faults of the run. The time of each fault, in seconds, is relative to the event that the fault specifies."""
    clients: tuple[Act, ...] = ()
    """Client actions other than the jobs. Action times are relative to the activation of the arm."""
    limits: dict[str, tuple[Position, Position]] = {}
    """Narrower lower and upper joint limits, in rad or m, like those set by a ``<command_interface>`` of the URDF."""
    firmware: FirmwareVersion | None = None
    """Firmware version of all Dynamixels X; None for the version in the robot file, or else the usual version."""
    on_exit: ExitPolicy | None = None
    """Exit policy of the arm; None to use the robot file's policy for virtual servos."""
    hurry_s: Time | None = None
    """Time from the first to a second signal, which skips the motion to the park pose, in seconds; None for one
    signal."""


def read_schedule(path: Path) -> Schedule:
    """Read a schedule from a YAML file.

    Raises:
        ScheduleError: The file has errors, a fault or action starts after the end of the run, or the arm would be in
            two freedrives.
        ArmFileError: The arm does not exist.
    """
    schedule = load(path, Schedule, ScheduleError)
    arm_in(path, schedule.arm)
    late = [((*place, "at_s"), text) for place, text in after_the_end(schedule)]
    if wrong := (*late, *_second_freedrives(schedule)):
        file = compose(path, ScheduleError)
        raise ScheduleError("\n".join(f"{file.place(place)}: {text}" for place, text in wrong))
    return schedule


def after_the_end(schedule: Schedule) -> list[tuple[tuple[str, int], str]]:
    """Return the keys and a message for each fault or action that is scheduled to start after the run ends.

    Return nothing for schedules with jobs, because the duration of these runs is not known in advance.
    """
    if schedule.job:
        return []
    end_s, faults, acts = schedule.seconds, enumerate(schedule.faults), enumerate(schedule.clients)
    late = [(("faults", n), _late(one, end_s)) for n, one in faults if one.since == "up" and one.at_s > end_s]
    return late + [(("clients", n), _late(act, end_s)) for n, act in acts if act.at_s > end_s]


def _late(one: FaultEvent | Act, end_s: float) -> str:
    text = f"{one.kind} starts at {one.at_s:g} s, but the run ends after {end_s:g} s: start it earlier"
    if isinstance(one, Event):
        return f"{text}, increase `seconds`, or use `since: end`"
    return f"{text}, or increase `seconds`"


def _second_freedrives(schedule: Schedule) -> list[tuple[tuple[str, int], str]]:
    """Return the key and a message for each freedrive of a schedule whose programs on the command socket have their
    own freedrive."""
    if not any(isinstance(act, SocketAct) for act in schedule.clients):
        return []
    text = (
        "guide cannot be combined with actions on the command socket, because the freedrive of a stack belongs to the "
        "programs on this socket: use socket_request with `op: freedrive`, or remove the actions on the socket"
    )
    return [(("clients", n), text) for n, act in enumerate(schedule.clients) if isinstance(act, GuideArm)]


def schedule_text(schedule: Schedule) -> str:
    """Return a schedule as YAML for ``read_schedule``, without default values."""
    content = schedule.model_dump(exclude={"faults", "clients"}, exclude_defaults=True)
    content = {name: list(value) if isinstance(value, tuple) else value for name, value in content.items()}
    if schedule.faults:
        content["faults"] = [plain(event) for event in schedule.faults]
    if schedule.clients:
        content["clients"] = [act.model_dump() for act in schedule.clients]
    return yaml.safe_dump(content, sort_keys=False)
