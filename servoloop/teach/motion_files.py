"""Store the recorded motions of an arm, one YAML file each, in a folder next to the arm's other files."""

import re
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from itertools import pairwise
from pathlib import Path
from typing import Annotated, Any, Final, Literal, Self

import numpy as np
import yaml
from pydantic import BaseModel, ConfigDict, Field, model_validator

from commissioning.atomic_write import make_folder, write_whole
from controller.teach.hand_path import HandPath, excess, outside
from controller.trajectory.goal import LONGEST_GOAL_S
from drivers.driver_errors import DriverError
from hal.joint import Joint
from hal.plausible import AnyVelocity, NoTruth, Position
from hal.text_file import exists
from hal.types import AT_LIMIT, FloatArray, JointLimits, beyond_range
from hal.yaml_file import load_with_lines
from hal.yaml_nodes import YamlFile


class TeachError(DriverError):
    """Raised when a motion cannot be recorded, read or played."""


FOLDER: Final = "taught"
LONGEST_NAME: Final = 243
"""Maximum length of a name. A file name has at most 255 characters, and the suffix ``.yaml.1.part`` has twelve."""
NAME: Final = re.compile(rf"[A-Za-z0-9_-]{{1,{LONGEST_NAME}}}")
FASTEST_HAND: Final = {"rad": 20.0, "m": 2.0}
"""Maximum joint velocity of a path recorded by hand, in rad/s or m/s. If the path is faster than this, it contains a
jump."""
DIGITS: Final = 5
"""Decimal places of positions, velocities and times in a file. The encoders have a much lower resolution."""


class PointFile(BaseModel):
    """Point of a motion: values in the file's joint order, in rad or m and rad/s or m/s.

    Only points of a path have ``at_s`` and velocities.
    """

    model_config = ConfigDict(extra="forbid", frozen=True)

    at_s: Annotated[float, Field(ge=0.0, le=LONGEST_GOAL_S, allow_inf_nan=False), NoTruth] | None = None
    positions: list[Position]
    velocities: list[AnyVelocity] = []


class MotionFile(BaseModel):
    """Contents of a motion file. The order of keys in mappings does not matter."""

    model_config = ConfigDict(extra="forbid", frozen=True)

    version: Annotated[Literal[2], NoTruth]
    joints: list[str] = Field(min_length=1)
    """Joints, in the order in which each point lists its positions and velocities."""
    units: dict[str, Literal["rad", "m"]]
    """Position unit of each joint."""
    points: list[PointFile] = Field(min_length=1)
    """Points of a path, with times, or poses without times."""

    @model_validator(mode="before")
    @classmethod
    def _has_an_order(cls, content: Any) -> Any:
        if isinstance(content, Mapping) and isinstance(content.get("joints"), Mapping):
            raise ValueError(
                "joints must be a list. Another program may have changed the order of the mapping, so positions cannot "
                "be assigned to joints: record the motion again"
            )
        return content

    @model_validator(mode="after")
    def _names_each_joint_once(self) -> Self:
        if len(set(self.joints)) < len(self.joints):
            raise ValueError(f"joints lists a joint twice: {', '.join(self.joints)}")
        if self.units.keys() != set(self.joints):
            raise ValueError(
                f"units has {', '.join(self.units) or 'no joint'}, but joints has {', '.join(self.joints)}"
            )
        return self

    @model_validator(mode="after")
    def _one_kind(self) -> Self:
        times = [point.at_s for point in self.points if point.at_s is not None]
        velocities = len(self.joints) if times else 0
        if times and (len(times) != len(self.points) or len(times) < 2 or times[0] != 0.0):
            raise ValueError("a path needs at least two points, all with at_s, starting at 0; poses must not have at_s")
        if any(later <= before for before, later in pairwise(times)):
            raise ValueError("at_s must increase from point to point")
        for number, point in enumerate(self.points):
            if (len(point.positions), len(point.velocities)) != (len(self.joints), velocities):
                raise ValueError(f"points.{number} needs {len(self.joints)} positions and {velocities} velocities")
        return self


@dataclass(frozen=True, slots=True)
class RecordedMotion:
    """Recorded motion: joints, and their positions (m, n) in time order, in rad or m."""

    joints: tuple[str, ...]
    position: FloatArray
    path: HandPath | None = None
    """Path through the positions; None if the motion consists of poses, with a stop at each pose."""
    units: Mapping[str, str] = field(default_factory=dict)
    """Position unit of each joint, if the motion was read from a file."""
    file: YamlFile | None = None
    """File from which the motion was read, if any."""

    def of(self, joints: Sequence[str], source: str) -> "RecordedMotion":
        """Return the motion with its joints in this order.

        Raises TeachError if the joints differ. ``source`` is how error messages refer to the motion.
        """
        missing = [name for name in joints if name not in self.joints]
        strange = [name for name in self.joints if name not in joints]
        if missing or strange:
            wrong = [f"it has no {', '.join(missing)}"] * bool(missing)
            wrong += [f"the arm has no {', '.join(strange)}"] * bool(strange)
            raise TeachError(
                f"{source} was recorded on a different arm: {'; '.join(wrong)}. Choose that arm with --arm"
            )
        order = [self.joints.index(name) for name in joints]
        path = self.path and HandPath(self.path.times_s, self.path.position[:, order], self.path.velocity[:, order])
        return replace(self, joints=tuple(joints), position=self.position[:, order], path=path)

    def check(self, limits: Sequence[JointLimits], source: str) -> None:
        """Check that all positions are within the limits, which are in joint order.

        Raises TeachError if the check fails.
        """
        wrong = [
            self._too_far(index, int(point), limit)
            for index, limit in enumerate(limits)
            for point in (self.position[:, index].argmin(), self.position[:, index].argmax())
            if not limit.lower <= self.position[point, index] <= limit.upper
        ]
        if wrong:
            raise TeachError(f"{source}: {'; '.join(wrong)}")
        if self.path is not None:
            _check_path(self, self.path, limits, source)

    def check_units(self, joints: Sequence[Joint], source: str) -> None:
        """Check that the file uses the units of these joints. Raises TeachError if the check fails."""
        wrong = [
            f"{joint.name} is in {self.units[joint.name]}, but the arm's joint is in {_unit(joint)}"
            f"{self._line('units', joint.name)}"
            for joint in joints
            if self.units.get(joint.name, _unit(joint)) != _unit(joint)
        ]
        if wrong:
            raise TeachError(
                f"{source} was recorded on a different arm: {'; '.join(wrong)}. Choose that arm with --arm"
            )

    def points(self, first: int) -> str:
        """Return a description of point ``first`` and the next point, for error messages."""
        return f"points {first}{self._line('points', first)} and {first + 1}{self._line('points', first + 1)}"

    def _too_far(self, index: int, point: int, limit: JointLimits) -> str:
        far, lower, upper = beyond_range(float(self.position[point, index]), limit.lower, limit.upper)
        place = f"point {point}{self._line('points', point)}"
        return f"{self.joints[index]} would go to {far} at {place}, but its limits are {lower} to {upper}"

    def _line(self, *location: str | int) -> str:
        """Return the line number of an element of the file as a suffix for messages, or an empty string if there is no
        file."""
        return "" if self.file is None else f" (line {self.file.line(location)})"


def _unit(joint: Joint) -> str:
    return joint.unit


def _check_path(motion: RecordedMotion, path: HandPath, limits: Sequence[JointLimits], source: str) -> None:
    """Check that a path has no jumps and stays within the limits between its points.

    Raises TeachError if the check fails.
    """
    units = [motion.units.get(name, "rad") for name in motion.joints]
    spans_s = np.diff(path.times_s)
    speeds = np.abs(np.diff(path.position, axis=0)) / spans_s[:, None]
    fastest = np.maximum(speeds, np.maximum(np.abs(path.velocity[:-1]), np.abs(path.velocity[1:])))
    too_fast = np.argwhere(fastest > [FASTEST_HAND[unit] for unit in units]).tolist()
    if too_fast:
        (at, column), unit = too_fast[0], units[too_fast[0][1]]
        jump = float(path.position[at + 1, column] - path.position[at, column])
        raise TeachError(
            f"{source}: {motion.joints[column]} jumps by {jump:+.4f} {unit} in {spans_s[at]:.4f} s between "
            f"{motion.points(at)} ({fastest[at, column]:.0f} {unit}/s), too fast for a motion by hand: record the "
            "motion again"
        )
    sampled = path.sampled()
    swings = excess(sampled.position, limits)
    for index, (name, limit, by) in enumerate(zip(motion.joints, limits, swings.max(axis=0).tolist(), strict=True)):
        if by > AT_LIMIT * (limit.upper - limit.lower):
            at = path.knot_before(float(sampled.times_s[swings[:, index].argmax()]))
            raise TeachError(
                f"{source}: {name} would exceed its limits {limit.lower:.4f} to {limit.upper:.4f} by {by:.3f} "
                f"between {motion.points(at)}, whose velocities do not match their positions: record the motion again"
            )


def check_duration(duration_s: float, source: str) -> None:
    """Check that a motion is not longer than the longest trajectory goal. Raises TeachError if the check fails."""
    if duration_s > LONGEST_GOAL_S:
        raise TeachError(
            f"{source} would take {duration_s:.0f} s, but a motion may take at most {LONGEST_GOAL_S:.0f} s: play it "
            "faster, or record it in parts"
        )


def beyond(position: FloatArray, joints: Sequence[str], limits: Sequence[JointLimits]) -> list[str]:
    """Return a warning for each joint with positions (m, n) beyond its limits."""
    far = outside(position, limits).tolist()
    return [
        f"{name} went {by:.3f} beyond its limits {limit.lower:.4f} to {limit.upper:.4f}: its positions are clipped"
        for name, limit, by in zip(joints, limits, far, strict=True)
        if by > AT_LIMIT * (limit.upper - limit.lower)
    ]


class MotionStore:
    """Recorded motions of one arm, keyed by name.

    All methods raise TeachError if a file has errors or cannot be read or written.
    """

    def __init__(self, folder: Path) -> None:
        """``folder`` is the folder of the arm."""
        self._folder = folder / FOLDER

    def all(self) -> dict[str, RecordedMotion | TeachError]:
        """Return all motions, keyed by name. If a file has errors, its value is the error."""
        found: dict[str, RecordedMotion | TeachError] = {}
        for name in self._names():
            try:
                found[name] = self.get(name)
            except TeachError as error:
                path = self._folder / f"{name}.yaml"
                found[name] = error if NAME.fullmatch(name) else TeachError(f"{path}: {error}")
        return found

    def get(self, name: str) -> RecordedMotion:
        """Return the motion with this name."""
        return _taught(*load_with_lines(self._existing(name), MotionFile, TeachError))

    def require_writable(self) -> None:
        """Create the folder and check that it is writable, before a motion is recorded. Raises DriverError."""
        make_folder(self._folder)

    def save(self, name: str, motion: RecordedMotion, joints: Mapping[str, Joint]) -> None:
        """Save a motion. An existing motion with this name is renamed to ``NAME.yaml.1``."""
        try:
            write_whole(
                self.path(name),
                yaml.safe_dump(_plain(motion, joints), sort_keys=False, default_flow_style=None, width=1000),
            )
        except OSError as error:
            raise TeachError(f"cannot write {self.path(name)}: {error.strerror}") from error

    def remove(self, name: str) -> None:
        """Delete a motion and its previous version."""
        path = self._existing(name)
        try:
            for one in (path.with_name(f"{name}.yaml.1"), path):
                one.unlink(missing_ok=True)
        except OSError as error:
            raise TeachError(f"cannot remove {one}: {error.strerror}") from error

    def path(self, name: str) -> Path:
        """Return the path of a motion's file. Raises TeachError if the name is invalid."""
        if not NAME.fullmatch(name):
            raise TeachError(
                f"{name!r} is not a valid name: use only letters, digits, _ and -, and at most {LONGEST_NAME} of them"
            )
        return self._folder / f"{name}.yaml"

    def _existing(self, name: str) -> Path:
        """Return the path of an existing file. Raises TeachError if there is no motion with this name."""
        path = self.path(name)
        if not exists(path, TeachError):
            known = ", ".join(self._names()) or "none"
            raise TeachError(f"there is no motion {name} in {self._folder}. Recorded motions: {known}")
        return path

    def _names(self) -> list[str]:
        return sorted(path.stem for path in self._folder.glob("*.yaml"))


def _taught(content: MotionFile, file: YamlFile) -> RecordedMotion:
    position = np.array([point.positions for point in content.points])
    path = None
    if content.points[0].at_s is not None:
        times_s = np.array([point.at_s for point in content.points])
        path = HandPath(times_s, position, np.array([point.velocities for point in content.points]))
    return RecordedMotion(tuple(content.joints), position, path, content.units, file)


def _plain(motion: RecordedMotion, joints: Mapping[str, Joint]) -> dict[str, object]:
    """Return the contents of the file, with rounded numbers."""
    units = {name: _unit(joints[name]) for name in motion.joints}
    rows: list[dict[str, object]] = [{"positions": row} for row in np.round(motion.position, DIGITS).tolist()]
    if motion.path is not None:
        times_s = np.round(motion.path.times_s, DIGITS).tolist()
        velocities = np.round(motion.path.velocity, DIGITS).tolist()
        rows = [
            {"at_s": time_s, **row, "velocities": velocity}
            for time_s, row, velocity in zip(times_s, rows, velocities, strict=True)
        ]
    return {"version": 2, "joints": list(motion.joints), "units": units, "points": rows}
