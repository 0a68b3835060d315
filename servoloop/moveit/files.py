"""Implementation of ``servoloop arms moveit``: write the MoveIt configuration for an arm.

The comments and the sections that are the same for all arms come from config/moveit. The other sections are generated
from the arm's folder.
"""

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Final
from xml.etree import ElementTree

from commissioning.atomic_write import make_folder, write_file
from hal.hal_errors import ArmFileError
from hal.robot_file.robot_file import load_robot_file
from planning.srdf_file import read_pairs
from servoloop.motion_planning.collision_matrix import SAMPLES, Pair, reasons
from servoloop.motion_planning.robot import srdf_of
from servoloop.moveit.group_settings import KINEMATICS, PLANNERS, RVIZ, group_names, group_settings
from servoloop.moveit.plannable import PaddedArm, rest_poses, working_poses
from servoloop.moveit.srdf import States, srdf
from servoloop.moveit.surroundings import CollisionShape, Objects, base_link, surroundings
from servoloop.stack.arm_folders import ArmFolder, read_arm_files
from servoloop.stack.pick_place import load_pick_place
from servoloop.stack.robot_files import Files
from servoloop.stack.shipped_files import CONFIG

MOVEIT: Final = CONFIG / "moveit"
"""Folder with the MoveIt configuration of the default arm."""
COPIED: Final = (KINEMATICS, PLANNERS, RVIZ)
PADDINGS_M: Final = (0.02, 0.015, 0.01)
"""Padding values to try, in m, largest first.

Even the smallest padding exceeds the sag of the hand if each joint sags by 6 mrad.
"""
VELOCITY_SHARE: Final = 0.9
ACCELERATION_SHARE: Final = 0.8
TRAJECTORY: Final = "joint_trajectory_controller/JointTrajectoryController"
GRIPPERS: Final = ("position_controllers/GripperActionController", "effort_controllers/GripperActionController")


def moveit_files(arm: ArmFolder, samples: int = SAMPLES) -> dict[str, str]:
    """Return the contents of MoveIt's files, keyed by file name.

    Raises HalError if MoveIt cannot start planning from some of the poses. The message lists these poses.
    """
    files = read_arm_files(arm)
    several = sum(spec.kind == TRAJECTORY for spec in files.controllers.controllers) > 1
    semantic = _semantic(arm, files) if several else None
    unchecked = read_pairs(semantic) if semantic else reasons(arm.scene, samples)
    lying = rest_poses(arm)
    poses = {**lying, **working_poses(arm)}
    for padding_m in PADDINGS_M:
        objects = surroundings(arm.scene, padding_m, list(lying.values()))
        padded = PaddedArm(arm.scene, objects, padding_m, unchecked)
        blocked = {name: padded.collisions(pose) for name, pose in poses.items()}
        if not any(blocked.values()):
            break
    else:
        found = "\n".join(f"{name}: {', '.join(pairs)}" for name, pairs in blocked.items() if pairs)
        raise ArmFileError(
            f"MoveIt cannot plan from these poses of {arm.name}, even with a padding of {padding_m} m: change the "
            f"poses or the scene\n{found}"
        )
    own = _of_several_arms(files, semantic) if semantic else _of_one_arm(arm, files, unchecked)
    base = base_link(arm.scene)
    return {
        f"{arm.name}.urdf": files.description.xml,
        "joint_limits.yaml": joint_limits(files, padding_m),
        "moveit_controllers.yaml": moveit_controllers(files),
        "planning_scene.yaml": planning_scene(objects, base),
        **own,
        RVIZ: own[RVIZ].replace("Fixed Frame: base_link\n", f"Fixed Frame: {base}\n"),
    }


def _semantic(arm: ArmFolder, files: Files) -> Path:
    """Return the SRDF of a robot with several arms. Raises ArmFileError."""
    if (found := srdf_of(files)) is None:
        raise ArmFileError(
            f"{arm.name} has several trajectory controllers, but no SRDF with a group for each arm: "
            f"put {arm.name}.srdf into {arm.folder}, or combine the arms with `servoloop arms combine`"
        )
    return found


def _of_several_arms(files: Files, semantic: Path) -> dict[str, str]:
    """Return the SRDF of the robot, and the files with the settings of its groups."""
    return {f"{files.arm}.srdf": semantic.read_text(), **group_settings(MOVEIT, group_names(files))}


def _of_one_arm(arm: ArmFolder, files: Files, unchecked: Mapping[Pair, str]) -> dict[str, str]:
    """Return the SRDF, and the files with the settings of the ``arm`` and ``hand`` groups."""
    groups = _groups(files)
    name = ElementTree.fromstring(files.description.xml).get("name", arm.name)
    copied = {name: (MOVEIT / name).read_text() for name in COPIED}
    return {f"{arm.name}.srdf": srdf(name, files.description, groups, _states(arm, groups), unchecked), **copied}


def write_moveit(arm: ArmFolder, folder: Path) -> list[Path]:
    """Write MoveIt's files to a folder. Existing files are renamed to NAME.1. Raises HalError."""
    written = moveit_files(arm)
    make_folder(folder)
    for name, text in written.items():
        write_file(folder / name, text)
    return [folder / name for name in written]


def _groups(files: Files) -> dict[str, tuple[str, ...]]:
    """Return the joints of the arm (those of the first trajectory controller) and of the hand (all others)."""
    trajectories = [spec for spec in files.controllers.controllers if spec.kind == TRAJECTORY]
    if not trajectories:
        raise ArmFileError(
            f"{files.controllers.path} has no {TRAJECTORY}, which MoveIt needs to move the arm: add such a controller"
        )
    arm = tuple(getattr(trajectories[0].parameters, "joints", ()))
    hand = tuple(joint.name for joint in files.robot.joints if joint.name not in arm)
    return {"arm": arm, "hand": hand} if hand else {"arm": arm}


def _states(arm: ArmFolder, groups: Mapping[str, Sequence[str]]) -> States:
    job, park = load_pick_place(arm.pick_place), load_robot_file(arm.robot).park
    states = {("arm", "ready"): dict(zip(job.joints, job.poses.ready, strict=True))}
    parked = {} if park is None else {joint: park.pose[joint] for joint in groups["arm"] if joint in park.pose}
    if parked:
        states["arm", "park"] = parked
    hand = groups.get("hand", ())
    if len(hand) == 1:
        states["hand", "open"] = {hand[0]: job.hand_open_m}
        states["hand", "close"] = {hand[0]: job.hand_closed_m}
    return states


def header(name: str, before: str) -> str:
    """Return the text that precedes a given line in a file in config/moveit."""
    text = (MOVEIT / name).read_text()
    return text[: text.index(f"\n{before}") + 1]


def joint_limits(files: Files, padding_m: float) -> str:
    """Return joint_limits.yaml: fractions of the URDF's velocity limits and of the robot file's acceleration limits."""
    padding = "default_robot_padding: "
    text = header("joint_limits.yaml", padding) + f"{padding}{padding_m}\n\njoint_limits:\n"
    for joint in files.robot.joints:
        own = files.robot.file.joints[joint.name]
        velocity = files.description.joints[joint.name].velocity
        text += f"  {joint.name}:\n"
        for kind, value in (
            ("velocity", VELOCITY_SHARE * velocity),
            ("acceleration", ACCELERATION_SHARE * own.acceleration),
            ("jerk", own.jerk),
        ):
            text += f"    has_{kind}_limits: true\n    max_{kind}: {round(float(value), 6)}\n"
    return text


def moveit_controllers(files: Files) -> str:
    """Return moveit_controllers.yaml, with the controllers that MoveIt can use and their actions."""
    entries: dict[str, str] = {}
    for spec in files.controllers.controllers:
        parameters = spec.parameters
        if spec.kind == TRAJECTORY:
            action, joints = ("FollowJointTrajectory", "follow_joint_trajectory"), getattr(parameters, "joints", ())
        elif spec.kind in GRIPPERS:
            action, joints = ("GripperCommand", "gripper_cmd"), (getattr(parameters, "joint", ""),)
        else:
            continue
        entries[spec.name] = (
            f"  {spec.name}:\n    type: {action[0]}\n    action_ns: {action[1]}\n    default: true\n"
            f"    joints: [{', '.join(joints)}]\n"
        )
    begin = "moveit_simple_controller_manager:"
    names = f"  controller_names: [{', '.join(entries)}]\n"
    return header("moveit_controllers.yaml", begin) + f"{begin}\n{names}{''.join(entries.values())}"


def planning_scene(objects: Objects, frame: str) -> str:
    """Return planning_scene.yaml, which contains the objects in a frame as a request to /apply_planning_scene."""
    begin = "scene:"
    text = header("planning_scene.yaml", begin) + (
        f"{begin}\n  is_diff: true\n  robot_state: {{is_diff: true}}\n  world:\n    collision_objects:\n"
    )
    for name, shapes in objects.items():
        text += f"      - id: {name}\n        header: {{frame_id: {frame}}}\n        primitives:\n"
        text += "".join(
            f"          - {{type: {shape.kind}, dimensions: [{', '.join(map(str, shape.dimensions))}]}}\n"
            for shape in shapes
        )
        text += "        primitive_poses:\n" + "".join(f"          - {_pose(shape)}\n" for shape in shapes)
    return text


def _pose(shape: CollisionShape) -> str:
    x, y, z = shape.position
    position = f"position: {{x: {x}, y: {y}, z: {z}}}"
    qx, qy, qz, qw = shape.quaternion_xyzw
    turned = (qx, qy, qz) != (0.0, 0.0, 0.0)
    orientation = f", orientation: {{x: {qx}, y: {qy}, z: {qz}, w: {qw}}}" if turned else ""
    return f"{{{position}{orientation}}}"
