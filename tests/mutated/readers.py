"""The kinds of files that users write: good ones, and what the commands do with them before anything moves."""

import json
import tempfile
from collections.abc import Callable
from dataclasses import dataclass
from functools import cache
from itertools import chain
from pathlib import Path
from typing import Final

import numpy as np
import yaml

from commissioning.calibrations import calibration_rows, export_calibration, import_calibration
from controller.interface import ControllerContext
from controller.loop import ControlLoop
from controller.manager.factory import Factory
from controller.manager.manager import ControllerManager
from drivers.clock import MonotonicClock
from hal.errors import ArmFileError
from hal.robot_description.urdf import UrdfJoint
from hal.robot_file.calibration_file import calibration_path
from servoloop.arms.check import check_arm
from servoloop.arms.folder import ARMS, OWN, arms, find_arm, read_arm_files, read_arm_servos
from servoloop.arms.pick_place import load_pick_place
from servoloop.campaign.campaign import read_scenario, schedule_of
from servoloop.emulator import virtual_lines
from servoloop.files import CONFIG, HOME, Files, initial_states
from servoloop.handling.poses import Poses
from servoloop.hardware import build, compensation
from servoloop.live.recording import Recording
from servoloop.moveit.surroundings import surroundings
from servoloop.recorder.page import page
from servoloop.recorder.reader import read_recording
from servoloop.simulation.schedule import Schedule, read_schedule
from servoloop.simulation.simulate import simulate
from servoloop.simulation.stack_faults import inventory_of, require_possible_in
from servoloop.simulation.virtual_lines import VirtualLines
from servoloop.teach.recorded import recorded_motion
from servoloop.teach.taught import TaughtMotions
from servoloop.verbs.arm_options import known_arm
from servoloop.view.arm_model import ArmModel
from servoloop.view.shapes import scene_shapes, shapes, thing_shapes
from sim_backend.eeprom import keep_eeprom
from sim_backend.faults.draw import draw
from sim_backend.faults.events import KINDS as KINDS_OF_FAULTS
from sim_backend.faults.script import read_script, script_text
from sim_backend.mechanics.build import Build
from sim_backend.mechanics.plant import BenchPlant
from sim_backend.scene.scene_check import require_scene, scene_problems
from sim_backend.scene.world import World
from tests.recorder.foreign import State, swing, write_states

TESTS: Final = HOME / "tests"
SO101: Final = "so101"


@dataclass(frozen=True, slots=True)
class Kind:
    """A kind of file: its name in a folder of its own, the good files, and the reader of that folder."""

    name: str
    good: Callable[[], list[bytes]]
    read: Callable[[Path], None]
    beside: Callable[[Path], None] = lambda folder: None
    """Writes what must be beside the file."""


def of_paths(*paths: Path) -> Callable[[], list[bytes]]:
    return lambda: [path.read_bytes() for path in paths]


def come_up(files: Files) -> None:
    """All that ``servoloop up`` and ``servoloop emulate`` make of the files before a port is opened."""
    initial_states(files)
    devices = {name: f"/dev/none{name}" for name in files.robot.file.lines()}
    clock = MonotonicClock()
    setup = build(None, files, devices, clock)
    manager = ControllerManager(setup.hardware, files.limits)
    context = ControllerContext(files.description, files.component, files.limits, lambda: True, setup.compliances)
    Factory(files.controllers, context).fill(manager)
    ControlLoop(setup.hardware, manager, files.limits, clock, 1.0 / files.controllers.update_rate_hz)
    emulated(files)


def emulated(files: Files) -> None:
    VirtualLines(files, Build())
    if gravity := compensation(files.robot.joints, files.description):
        gravity.enabled = False


def read_robot(arm: str) -> Callable[[Path], None]:
    return lambda path: come_up(read_arm_files(find_arm(arm), robot=path))


def read_urdf(arm: str) -> Callable[[Path], None]:
    def read(path: Path) -> None:
        own = find_arm(arm)
        files = read_arm_files(own, urdf=path, robot=own.robot)
        scene_problems(own.scene, files.description.xml, files.component.joints)
        drawn(files, path)
        come_up(files)

    return read


def drawn(files: Files, urdf: Path) -> None:
    """What the page of ``servoloop view`` makes of a robot description."""
    shapes(files.description.xml, urdf.parent)
    joints: dict[str, UrdfJoint] = dict(files.description.joints)
    model = ArmModel(joints, files.component.joints)
    list(model.fixed())
    list(model.moving(np.zeros(len(files.component.joints))))
    for link in model.links:
        model.branch(link)
        model.joint_of(link)


def read_controllers(path: Path) -> None:
    come_up(read_arm_files(find_arm(), controllers=path))


def read_pick_place(path: Path) -> None:
    load_pick_place(path).settings()


def read_faults(path: Path) -> None:
    require_possible_in(path, read_script(path), inventory_of(read_arm_servos(find_arm()).robot), ())


def read_whole_schedule(path: Path) -> None:
    schedule = read_schedule(path)
    arm = find_arm(schedule.arm)
    load_pick_place(arm.pick_place)
    require_possible_in(path, schedule.faults, inventory_of(read_arm_servos(arm).robot))


def read_campaign(path: Path) -> None:
    schedule_of(read_scenario(path), 0)


def read_scene(arm: str) -> Callable[[Path], None]:
    def read(path: Path) -> None:
        files = read_arm_servos(find_arm(arm))
        scene_problems(path, files.description.xml, files.component.joints)
        require_scene(path, files.component.joints)
        World(path, backlash=dict.fromkeys(files.component.joints, 0.01))
        list(chain(scene_shapes(path), thing_shapes(path)))
        surroundings(path, 0.01, [])

    return read


@cache
def files_of(arm: str) -> Files:
    return read_arm_files(find_arm(arm))


def read_taught(path: Path) -> None:
    joints = files_of(SO101).robot.joints
    for taught in TaughtMotions(path.parents[1]).all().values():
        own = taught.of([joint.name for joint in joints], str(path))
        own.check_units(joints, str(path))
        own.check([joint.limits for joint in joints], str(path))


def read_poses(path: Path) -> None:
    poses = Poses(path.parent)
    for name in list(poses.all())[:10]:
        poses.check(name, files_of(SO101).limits)


def beside_robot(folder: Path) -> None:
    (folder / "robot.yaml").write_bytes(find_arm(SO101).robot.read_bytes())


def read_calibration(path: Path) -> None:
    robot = path.with_name("robot.yaml")
    known = known_arm(SO101, robot=robot)
    calibration_rows(known.robot, known.joints)
    come_up(read_arm_files(find_arm(SO101), robot=robot))
    export_calibration(path.with_name("exported.json"), robot)


def read_lerobot(path: Path) -> None:
    robot = path.with_name("robot.yaml")
    calibration_path(robot).unlink(missing_ok=True)
    known = known_arm(SO101, robot=robot)
    import_calibration(path, robot, known.joints, known.plans)


def good_calibration() -> bytes:
    joint = {"sign": 1, "zero_counts": 2048, "homing_offset": 12, "lower_counts": 900, "upper_counts": 3200}
    joints = {one.name: {"servo_id": one.servo_id, **joint} for one in files_of(SO101).robot.joints}
    return yaml.safe_dump({"joints": joints}).encode()


def good_lerobot() -> bytes:
    joint = {"drive_mode": 0, "homing_offset": -120}
    found = {}
    for one in files_of(SO101).robot.joints:
        half = round(0.5 * (one.limits.upper - one.limits.lower) / abs(one.units_per_count))
        found[one.name] = {"id": one.servo_id, **joint, "range_min": 2048 - half, "range_max": 2047 + half}
    return json.dumps(found).encode()


def good_taught() -> list[bytes]:
    joints = files_of(SO101).robot.joints
    names, middles = [j.name for j in joints], [round(0.5 * (j.limits.lower + j.limits.upper), 4) for j in joints]
    content = {"version": 2, "joints": names, "units": dict.fromkeys(names, "rad")}
    poses = [{"positions": middles}, {"positions": [at + 0.01 for at in middles]}]
    path = [{"at_s": at, "positions": middles, "velocities": [0.0] * len(names)} for at in (0.0, 1.5, 3.0)]
    return [yaml.safe_dump({**content, "points": points}, sort_keys=False).encode() for points in (poses, path)]


def good_poses() -> bytes:
    pose = {joint.name: 0.1 for joint in files_of(SO101).robot.joints}
    return yaml.safe_dump({"poses": {"home": pose, "up": pose}}).encode()


def good_faults() -> list[bytes]:
    there = inventory_of(files_of(OWN).robot)
    return [script_text(draw(0, there, 10.0, 2, [kind])).encode() for kind in KINDS_OF_FAULTS]


def read_eeprom(path: Path) -> None:
    robot = files_of(SO101).robot
    lines = virtual_lines(robot, BenchPlant([joint.servo_id for joint in robot.joints]))
    keep_eeprom(path, lines.values())


@cache
def good_eeprom() -> bytes:
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder) / "eeprom.yaml"
        read_eeprom(path)
        return path.read_bytes()


def beside_arm(folder: Path) -> None:
    """The other files of an arm."""
    for path in find_arm(SO101).folder.iterdir():
        if path.is_file():
            (folder / path.name).write_bytes(path.read_bytes())


def read_arm_folder(path: Path) -> None:
    """What ``servoloop arms check`` prints is an error here."""
    if problems := check_arm(path.parent):
        raise ArmFileError("\n".join(problems))


@cache
def good_recordings() -> list[bytes]:
    """One of ``servoloop simulate``, and two as other programs write them."""
    joints = files_of(SO101).robot.joints
    others = {joint.name: 0.5 * (joint.limits.lower + joint.limits.upper) for joint in joints}
    with tempfile.TemporaryDirectory() as folder:
        own = Path(folder) / "own.mcap"
        simulate(files_of(SO101), load_pick_place(find_arm(SO101).pick_place).settings(), Schedule(seconds=1.0), own)
        found = [own.read_bytes()]
        for number, joint in enumerate(joints[:2]):
            path = Path(folder) / f"{number}.mcap"
            states = [
                State(at, tuple(places), tuple(places.values()))
                for at, places in swing(joint.name, others, seconds=2.0, far=0.2)
            ]
            write_states(path, states)
            found.append(path.read_bytes())
    return found


def read_mcap(path: Path) -> None:
    """What ``plot``, ``view``, ``monitor`` and ``replay`` read."""
    joints = files_of(SO101).robot.joints
    page(read_recording(path), path.name)
    recording = Recording(path)
    for share in (0.0, 0.5, 1.0):
        recording.play_to(share * recording.length_s)
    recorded_motion(path, [joint.name for joint in joints], [joint.limits for joint in joints])


def _each(kind: str, read: Callable[[str], Callable[[Path], None]]) -> dict[str, Kind]:
    """A kind of file for each arm that has one of its own; ``read`` makes the reader for an arm's name."""
    paths = {getattr(arm, kind): arm.name for arm in reversed(arms())}
    names = {"urdf": "arm.urdf", "scene": "scene.xml", "robot": "robot.yaml"}
    return {f"{kind} of {name}": Kind(names[kind], of_paths(path), read(name)) for path, name in paths.items()}


KINDS: Final = {
    **_each("robot", read_robot),
    "robot with two buses": Kind("robot.yaml", of_paths(CONFIG / "robot_arm_two_buses.yaml"), read_robot("robot_arm")),
    **_each("urdf", read_urdf),
    "controllers": Kind("controllers.yaml", of_paths(CONFIG / "arm_controllers.yaml"), read_controllers),
    "pick-place": Kind("pick_place.yaml", of_paths(*sorted({arm.pick_place for arm in arms()})), read_pick_place),
    "faults": Kind("faults.yaml", good_faults, read_faults),
    "schedule": Kind("schedule.yaml", of_paths(*sorted((TESTS / "schedules").glob("*.yaml"))), read_whole_schedule),
    "campaign": Kind("campaign.yaml", of_paths(HOME / "docs" / "campaign.yaml"), read_campaign),
    **_each("scene", read_scene),
    "taught": Kind("taught/motion.yaml", good_taught, read_taught),
    "poses": Kind("poses.yaml", lambda: [good_poses()], read_poses),
    "calibration": Kind("robot.calibration.yaml", lambda: [good_calibration()], read_calibration, beside_robot),
    "lerobot": Kind("lerobot.json", lambda: [good_lerobot()], read_lerobot, beside_robot),
    "eeprom": Kind("eeprom.yaml", lambda: [good_eeprom()], read_eeprom),
    "arm": Kind("arm.yaml", of_paths(ARMS / SO101 / "arm.yaml"), read_arm_folder, beside_arm),
    "recording": Kind("run.mcap", good_recordings, read_mcap),
}
