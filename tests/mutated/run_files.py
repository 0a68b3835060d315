"""Files of runs: motions, poses and recordings, faults, schedules and campaigns."""

import tempfile
from functools import cache
from pathlib import Path
from typing import Final
from zlib import crc32

import yaml

from servoloop.campaign.campaign import read_scenario, require_possible_schedule, schedule_of
from servoloop.manual.poses import Poses
from servoloop.recording.page import page
from servoloop.recording.reader import read_recording
from servoloop.recording.sources import PlayedRecording
from servoloop.simulation.schedule import Schedule, read_schedule
from servoloop.simulation.simulate import simulate
from servoloop.simulation.stack_faults import inventory_of, require_possible_in
from servoloop.stack.arm_folders import find_arm, read_arm_servos
from servoloop.stack.pick_place import load_pick_place
from servoloop.stack.shipped_files import HOME, OWN
from servoloop.teach.motion_files import MotionStore
from servoloop.teach.recorded import recorded_motion
from sim_backend.faults.draw import draw
from sim_backend.faults.events import KINDS as KINDS_OF_FAULTS
from sim_backend.faults.script import read_script, script_text
from tests.mutated.kind import SO101, Kind, files_of, of_paths
from tests.recorder.foreign import State, swing, write_states

SCHEDULES: Final = sorted((HOME / "tests" / "schedules").glob("*.yaml"))


def read_faults(path: Path) -> None:
    require_possible_in(path, read_script(path), inventory_of(read_arm_servos(find_arm())), ())


def good_faults() -> list[bytes]:
    there = inventory_of(files_of(OWN))
    return [script_text(draw(0, there, 10.0, 2, [kind])).encode() for kind in KINDS_OF_FAULTS]


def read_whole_schedule(path: Path) -> None:
    require_possible_schedule(path, read_schedule(path))


def read_campaign(path: Path) -> None:
    schedule_of(read_scenario(path), 0)


def read_taught(path: Path) -> None:
    joints = files_of(SO101).robot.joints
    for motion in MotionStore(path.parents[1]).all().values():
        own = motion.of([joint.name for joint in joints], str(path))
        own.check_units(joints, str(path))
        own.check([joint.limits for joint in joints], str(path))


def good_taught() -> list[bytes]:
    joints = files_of(SO101).robot.joints
    names, middles = [j.name for j in joints], [round(0.5 * (j.limits.lower + j.limits.upper), 4) for j in joints]
    content = {"version": 2, "joints": names, "units": dict.fromkeys(names, "rad")}
    poses = [{"positions": middles}, {"positions": [at + 0.01 for at in middles]}]
    path = [{"at_s": at, "positions": middles, "velocities": [0.0] * len(names)} for at in (0.0, 1.5, 3.0)]
    return [yaml.safe_dump({**content, "points": points}, sort_keys=False).encode() for points in (poses, path)]


def read_poses(path: Path) -> None:
    poses = Poses(path.parent)
    for name in list(poses.all())[:10]:
        poses.check(name, files_of(SO101).limits)


def good_poses() -> list[bytes]:
    pose = {joint.name: 0.1 for joint in files_of(SO101).robot.joints}
    return [yaml.safe_dump({"poses": {"home": pose, "up": pose}}).encode()]


def read_mcap(path: Path) -> None:
    """Read a recording as ``plot``, ``view``, ``monitor`` and ``replay`` do."""
    joints = files_of(SO101).robot.joints
    run = read_recording(path)
    if crc32(path.read_bytes()) % 20 == 0:  # drawing takes a second
        page(run, path.name)
    recording = PlayedRecording(path)
    for share in (0.0, 0.5, 1.0):
        recording.play_to(share * recording.length_s)
    recorded_motion(path, [joint.name for joint in joints], [joint.limits for joint in joints])


@cache
def good_recordings() -> list[bytes]:
    """Return recordings in the format of other programs."""
    joints = files_of(SO101).robot.joints
    others = {joint.name: 0.5 * (joint.limits.lower + joint.limits.upper) for joint in joints}
    found = []
    with tempfile.TemporaryDirectory() as folder:
        for number, joint in enumerate(joints[:2]):
            path = Path(folder) / f"{number}.mcap"
            states = [
                State(at, tuple(places), tuple(places.values()))
                for at, places in swing(joint.name, others, seconds=2.0, far=0.2)
            ]
            write_states(path, states)
            found.append(path.read_bytes())
    return found


@cache
def good_recording() -> list[bytes]:
    """Return a recording of ``servoloop simulate`` that contains the motion of a joint."""
    job = load_pick_place(find_arm(SO101).pick_place)
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder) / "own.mcap"
        simulate(files_of(SO101), {"": job.settings()}, Schedule(arm=SO101, job=job.grades[:1]), path)
        return [path.read_bytes()]


KINDS: Final = {
    "taught": Kind("taught/motion.yaml", good_taught, read_taught),
    "poses": Kind("poses.yaml", good_poses, read_poses),
    "faults": Kind("faults.yaml", good_faults, read_faults),
    "schedule": Kind("schedule.yaml", of_paths(*SCHEDULES), read_whole_schedule),
    "campaign": Kind("campaign.yaml", of_paths(HOME / "docs" / "campaign.yaml"), read_campaign),
    "recording": Kind("run.mcap", good_recordings, read_mcap),
    "recording of servoloop": Kind("run.mcap", good_recording, read_mcap),
}
