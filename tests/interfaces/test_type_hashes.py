# ruff: noqa: E501
"""Tests that our message types equal the public ones field by field, because clients connect only if the hashes agree."""

import importlib
import json
import os
import sys
from pathlib import Path

import pytest

INTERFACES = Path(__file__).resolve().parents[2] / "interfaces"

# Hashes of a ROS 2 Jazzy installation: control_msgs 5.8, controller_manager_msgs 4.46, tf2_msgs of geometry2. Those of
# mujoco_ros2_control_msgs 0.0.3 are computed from its published fields.
PUBLIC = {
    "control_msgs/action/FollowJointTrajectory": "738ebcb7a2d7cfa42f9f1001cc99ce3a4383d1cfe508015d9be8485e4b1c66f6",
    "control_msgs/action/GripperCommand": "e17c0e644eccf14bea84a0a93e0977182872c2eb7873ca6694900059b46dbc84",
    "control_msgs/action/ParallelGripperCommand": "adfd3c1ebe8abc38ebcc0e454b6423d291d4010dd5697d14eca5b9be4726ae18",
    "control_msgs/msg/DynamicJointState": "18024c98a62697680f581108eeed40b28fb4542fa0ac5a8e36f56c62b6813d26",
    "control_msgs/msg/GripperCommand": "57eb8f326c9889ca8bb34ead82cc94cc09bf6bc5c3b6c09546dca3a00b589890",
    "control_msgs/msg/InterfaceValue": "74a12144ef6b7af67533195cb30f7f607d3301b66950208a72d280695f3e190c",
    "control_msgs/msg/JointComponentTolerance": "739ea7566931944d33830fa10f1bf5e7a7fbdc3172bce7a7eaac642bd6e3ffa4",
    "control_msgs/msg/JointTolerance": "c254f9cece0f3b733017b6990fd46d1326e25242d6b8844398c97d9a88e7d648",
    "control_msgs/msg/JointTrajectoryControllerState": "51d8dd89cc624cbe9daaeeb4d80d6de9b86168ffdc3be41fefc0953e3c26e480",
    "control_msgs/msg/SpeedScalingFactor": "0c240f349f2b74e33e8741f83e0f196ddeb6585923663876ed3c1f51f0566037",
    "control_msgs/srv/QueryTrajectoryState": "4a0935dffef18bc5b9e101c9d03d84e681ecd4cebd724b8f11fde008751a325a",
    "controller_manager_msgs/msg/ChainConnection": "2daecd1da4b171f48b291c79747657a651eb1ab8821b68e38b1c88c736bba91c",
    "controller_manager_msgs/msg/ControllerManagerActivity": "35b7de5d611b6780e89732de325f2f765eacdb8a7adfe5821a27af4a03a7c244",
    "controller_manager_msgs/msg/ControllerState": "9a8780ab9814b6032978a07c6c7033cf1a7894ac8d948a6fb72afea07b04cc83",
    "controller_manager_msgs/msg/HardwareComponentState": "8723f76b60e3ea54920065e3e777d93c68b76fc12839ad6a6ca4e0a6439b384c",
    "controller_manager_msgs/msg/HardwareInterface": "b4c556991db81ca56a49338b5e8f0675a6707faee54fba161d2bbd4d963d418a",
    "controller_manager_msgs/msg/NamedLifecycleState": "b7947b6f8df8f7e93d1cb8d115842fb0eeddfa6fb5c7b86cc0f3cafd55be4c1f",
    "controller_manager_msgs/srv/CleanupController": "0e5e0da84cf97150abbb3a4e2249c67e6f43dba01ed9b7228b4deaab8838ec4b",
    "controller_manager_msgs/srv/ConfigureController": "b5de498113f4eabc7b932e019ca0498d67304b1ca465fe8a426ea89644865ff9",
    "controller_manager_msgs/srv/ListControllerTypes": "873e8d2bb81b8b5903ca736d299ba959f929efec4b4a18d17354b8b322822e05",
    "controller_manager_msgs/srv/ListControllers": "4f8e36bb1fa5afdeba45c2d56ae6a2097b1493a253f961dd6290c085033bd189",
    "controller_manager_msgs/srv/ListHardwareComponents": "2ff105e609928671af16413362c0fdd089e1dd50c5a49d830db603ba8e4439c8",
    "controller_manager_msgs/srv/ListHardwareInterfaces": "c3e561a6e8cc7b9d577d8065c783038e51f6950cbe9bed67fb117a3e2e04d8f1",
    "controller_manager_msgs/srv/LoadController": "e37f7596c50c88cf8cb7a10cd376ff7579850cc63b5e787e9c8f11981f9ab4d2",
    "controller_manager_msgs/srv/ReloadControllerLibraries": "485cd0040f8a343a9596155b967363e1bc715f034bbb111f795c73d9d8056a9b",
    "controller_manager_msgs/srv/SetHardwareComponentState": "940b15846ed3e1fb561ab45edf77a992b811fd59c574f45d5205a84a0deb2f65",
    "controller_manager_msgs/srv/SwitchController": "d4ad10aa5da7808bc522d55d4123d8ef79de73d049d165639d7663ac37cc9895",
    "controller_manager_msgs/srv/UnloadController": "4055728e84c041348648d7f808c6681562000e3a9ce9fbb42c3350df25773f16",
    "mujoco_ros2_control_msgs/srv/SetPause": "1986432cfda29853ee9fd682f7c3d5b39a5af49f3b15e54de4f0e5a0db46d082",
    "mujoco_ros2_control_msgs/srv/StepSimulation": "362a1ee77a9c33e2680f5d71c5fb73b487e574ed3b5e570f45ae7239bcaee3e7",
    "tf2_msgs/msg/TFMessage": "e369d0f05a23ae52508854b66f6aa0437f3449d652e8cbf22d5abe85d020f087",
}

# Nodes of users contain these fields, so a change here breaks them.
SORTING_CELL = {
    "apple_quality_msgs/msg/AppleQuality": "428f4fa8d4872d1dab7c4d192850d341346088906f3d27e4b87611882d62da6e",
    "apple_quality_msgs/msg/AppleQualityArray": "d41a4f298046db54b9b251cd868583ab6fd8055ad5e83d9bba615d48a4d0fec4",
    "sorting_arm_interfaces/action/PickPlace": "dadb5f5e48750b17ee478b4792091f83673a2f2c03bbd9b20b20cf7cc0346e81",
}

EXPECTED = PUBLIC | SORTING_CELL


def built_hashes(name: str) -> dict[str, str]:
    """Return the hashes from the build of a type and of all types that it contains, by name."""
    prefixes = [*filter(None, os.environ.get("AMENT_PREFIX_PATH", "").split(os.pathsep)), sys.prefix]
    files = [Path(prefix) / "share" / f"{name}.json" for prefix in prefixes]
    found = [path for path in files if path.exists()]
    assert found, f"{name} is not built: make setup"
    return {entry["type_name"]: entry["hash_string"] for entry in json.loads(found[0].read_text())["type_hashes"]}


@pytest.mark.parametrize("name", EXPECTED)
def test_hash(name: str) -> None:
    assert built_hashes(name)[name] == f"RIHS01_{EXPECTED[name]}"


def test_every_type_of_ours_is_listed_here() -> None:
    files = [path for kind in ("msg", "srv", "action") for path in INTERFACES.glob(f"*/{kind}/*.{kind}")]
    assert {path.relative_to(INTERFACES).with_suffix("").as_posix() for path in files} == set(EXPECTED)


# Constants are not part of a hash.
CONSTANTS = [
    ("control_msgs.action", "FollowJointTrajectory.Result", "SUCCESSFUL", 0),
    ("control_msgs.action", "FollowJointTrajectory.Result", "INVALID_GOAL", -1),
    ("control_msgs.action", "FollowJointTrajectory.Result", "INVALID_JOINTS", -2),
    ("control_msgs.action", "FollowJointTrajectory.Result", "OLD_HEADER_TIMESTAMP", -3),
    ("control_msgs.action", "FollowJointTrajectory.Result", "PATH_TOLERANCE_VIOLATED", -4),
    ("control_msgs.action", "FollowJointTrajectory.Result", "GOAL_TOLERANCE_VIOLATED", -5),
    ("control_msgs.msg", "JointComponentTolerance", "X_AXIS", 1),
    ("control_msgs.msg", "JointComponentTolerance", "Y_AXIS", 2),
    ("control_msgs.msg", "JointComponentTolerance", "Z_AXIS", 3),
    ("control_msgs.msg", "JointComponentTolerance", "TRANSLATION", 4),
    ("control_msgs.msg", "JointComponentTolerance", "ROTATION", 5),
    ("controller_manager_msgs.srv", "SwitchController.Request", "BEST_EFFORT", 1),
    ("controller_manager_msgs.srv", "SwitchController.Request", "STRICT", 2),
    ("controller_manager_msgs.srv", "SwitchController.Request", "AUTO", 3),
    ("controller_manager_msgs.srv", "SwitchController.Request", "FORCE_AUTO", 4),
]


@pytest.mark.parametrize(("module", "path", "constant", "value"), CONSTANTS)
def test_constant(module: str, path: str, constant: str, value: int) -> None:
    owner = importlib.import_module(module)
    for part in path.split("."):
        owner = getattr(owner, part)
    assert getattr(owner, constant) == value


# The types of the pick-and-place cell have no public hash, so their fields are compared with the description of the
# cell.
FIELDS = [
    ("sorting_arm_interfaces.action", "PickPlace.Goal", {"grade": "string"}),
    (
        "sorting_arm_interfaces.action",
        "PickPlace.Result",
        {"success": "boolean", "request_id": "int32", "message": "string"},
    ),
    (
        "sorting_arm_interfaces.action",
        "PickPlace.Feedback",
        {"request_id": "int32", "phase": "string", "message": "string"},
    ),
    (
        "apple_quality_msgs.msg",
        "AppleQuality",
        {"grade": "string", "diameter_mm": "float", "red_ratio": "float", "defect_score": "float"},
    ),
    (
        "apple_quality_msgs.msg",
        "AppleQualityArray",
        {"header": "std_msgs/Header", "apples": "sequence<apple_quality_msgs/AppleQuality>"},
    ),
]


@pytest.mark.parametrize(("module", "path", "fields"), FIELDS)
def test_fields(module: str, path: str, fields: dict[str, str]) -> None:
    owner = importlib.import_module(module)
    for part in path.split("."):
        owner = getattr(owner, part)
    assert list(owner.get_fields_and_field_types().items()) == list(fields.items())
