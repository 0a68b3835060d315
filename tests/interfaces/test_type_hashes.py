# ruff: noqa: E501
"""Tests that our message types equal the public ones field by field, because clients connect only if the type hashes
agree."""

import importlib
import json
import os
import sys
from pathlib import Path

import pytest

INTERFACES = Path(__file__).resolve().parents[2] / "interfaces"

# Hashes of a ROS 2 Jazzy installation: control_msgs 5.8, controller_manager_msgs 4.46, and tf2_msgs of geometry2. The
# hashes of moveit_msgs 2.6, mujoco_ros2_control_msgs 0.0.3, object_recognition_msgs 2.0, octomap_msgs 2.0 and
# pal_statistics_msgs 2.6 are computed from their published fields.
PUBLIC = {
    "control_msgs/action/FollowJointTrajectory": "738ebcb7a2d7cfa42f9f1001cc99ce3a4383d1cfe508015d9be8485e4b1c66f6",
    "control_msgs/action/GripperCommand": "e17c0e644eccf14bea84a0a93e0977182872c2eb7873ca6694900059b46dbc84",
    "control_msgs/action/ParallelGripperCommand": "adfd3c1ebe8abc38ebcc0e454b6423d291d4010dd5697d14eca5b9be4726ae18",
    "control_msgs/msg/DynamicJointState": "18024c98a62697680f581108eeed40b28fb4542fa0ac5a8e36f56c62b6813d26",
    "control_msgs/msg/GripperCommand": "57eb8f326c9889ca8bb34ead82cc94cc09bf6bc5c3b6c09546dca3a00b589890",
    "control_msgs/msg/InterfaceValue": "74a12144ef6b7af67533195cb30f7f607d3301b66950208a72d280695f3e190c",
    "control_msgs/msg/JointComponentTolerance": "739ea7566931944d33830fa10f1bf5e7a7fbdc3172bce7a7eaac642bd6e3ffa4",
    "control_msgs/msg/JointJog": "ba249455a20f70168a1acb7bf43b776b72ff1f7eb5fc4cfea443f749e963c6e7",
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
    "moveit_msgs/action/ExecuteTrajectory": "e1ed3386f275fc8cea91cc78701074f892e78e583be2f8063eea5616dd1065fc",
    "moveit_msgs/action/MoveGroup": "8c41d70908a2d26b564ddac31e9710f697a753bbd2a4d229542f76271daefc0b",
    "moveit_msgs/msg/AllowedCollisionEntry": "eeb7cc3f1bfdb8c778aa7454ae90037c2749dab3ca0abdfe3dad2ae8723977db",
    "moveit_msgs/msg/AllowedCollisionMatrix": "ac0159eec0d99f73158c7349c9d1c01b3dc7f749d75a2ea22e74a2a1091a9b05",
    "moveit_msgs/msg/AttachedCollisionObject": "7fdfe7951a33a857f20fc42c9ed410a38d06dd0c209ac774ecea746dc487dc41",
    "moveit_msgs/msg/BoundingVolume": "00bb0df2edac637497dedf1778d8f217187c8d9d10f41dcfccc4d8578123ef13",
    "moveit_msgs/msg/CartesianPoint": "bbb5a879e7dd5b8443c3ce8cf374c3f314522a5540b1b4104a7b470fcc6ca907",
    "moveit_msgs/msg/CartesianTrajectory": "30452179003246bb9264a44854a4b720c882f63638da8da0a9afed4f565c748d",
    "moveit_msgs/msg/CartesianTrajectoryPoint": "63b1d2ef10058a5da0931e4de777a10fdfed3972ab166c60632f4a182b7fd5ea",
    "moveit_msgs/msg/CollisionObject": "74b0acd6d56be032bf4f764b2c2633f50588b5fb2bd71e97206c59052747cf7e",
    "moveit_msgs/msg/ConstraintEvalResult": "b632ab96d68fbfd587546b1c585a3b8be0606b7de7751929653392b343039997",
    "moveit_msgs/msg/Constraints": "71718200459ae8fecdc4f2c9631215f7eba5ff686c701a32e231ba8b11b3592b",
    "moveit_msgs/msg/ContactInformation": "47c926e539a1f54729ec4a9edc568a983678beefb908841d68fbb3cff3feeecb",
    "moveit_msgs/msg/CostSource": "dd6bd4e383e102b4b7ef54e46e2f8cd4b4323a2c56370c42862bd2d3358a59f6",
    "moveit_msgs/msg/DisplayTrajectory": "dd351cbd6d9986eb019306910ec09236a136a02dbc0b3465707cb62f2d56e22b",
    "moveit_msgs/msg/GenericTrajectory": "b38b4942aba82576ec047a9278c47785022ce66ca86d91827aba06cdc97793c6",
    "moveit_msgs/msg/JointConstraint": "4996641a8e12f5b7fde07f1cec1490324e1c4035ac5fc989ce99c9600c31e30d",
    "moveit_msgs/msg/LinkPadding": "864762d9e19f758b0385427f75691374cae830495727c96405f2bad0eb20c766",
    "moveit_msgs/msg/LinkScale": "4666a0685f26365ccf4c9bfed0b14c654604fa0564be65c221d8d54fdc7a0f83",
    "moveit_msgs/msg/MotionPlanRequest": "f82ed20da5f8f93146999c1a3cfe34b56b97fc10333b40cac69782a1210888d7",
    "moveit_msgs/msg/MotionPlanResponse": "bc0dc15c0462edc942dc45dc689cd1a1b1a64c1412002a2e8d210eff2477d62a",
    "moveit_msgs/msg/MoveItErrorCodes": "dcda8a9950cf6dd6ac221c2c0d2509f52f136afa0403dd19beacdf07e83e4a07",
    "moveit_msgs/msg/ObjectColor": "4f937f7b22942a9c4a6409c20255aaad1b5d9a003ae3c0edb779698be443c127",
    "moveit_msgs/msg/OrientationConstraint": "7a1917ac47886eb1fc170317952198b203bb797f07270475a7bbaf692cad2871",
    "moveit_msgs/msg/PlannerInterfaceDescription": "befe55b35f337f0fd4f84ddda3fe086960c47ef495a6b2a369991b3738b8f220",
    "moveit_msgs/msg/PlannerParams": "91fe6ebf17158d27240118bc8ccede6cca55d631c9a1cbce847b342761269d49",
    "moveit_msgs/msg/PlanningOptions": "2570a8ed681162d1d3afbce3a8e7ff2b6fd519676d13cf952e0a388072b255db",
    "moveit_msgs/msg/PlanningScene": "0f58540ad5eab4b9ea827d53b763c793d8cabd202b3b301fcee25afa4ce1bd80",
    "moveit_msgs/msg/PlanningSceneComponents": "76b77cb53f7a0b680d46fad6c0056d3710a74ec335dd5f361f3df62383313d69",
    "moveit_msgs/msg/PlanningSceneWorld": "e08e6a4a81ca6b6a6953ac758dadc2c949555093efea6a9a22d9accf62c2c099",
    "moveit_msgs/msg/PositionConstraint": "3758504dabfe337a1a660b29917e3405e5e858fdd6e9976edba04275396523df",
    "moveit_msgs/msg/PositionIKRequest": "200709be614f71f4d11d0bdd672785db28d27f7a10b516d9b961706a0c7f6d7d",
    "moveit_msgs/msg/RobotState": "7c516dc15713e545cb2836c5ca745fbdcfcc10de4855a41c83e6b4bf1afc3f83",
    "moveit_msgs/msg/RobotTrajectory": "af1dc87fb94d13e5f233e9c210d2662fa06143a8b3c6aec47c57ad45074fcce8",
    "moveit_msgs/msg/TrajectoryConstraints": "4975a7925aa917c5af450713fcb8bdbc19c666d0c336a5f27056733bf8fc65f8",
    "moveit_msgs/msg/VisibilityConstraint": "2b479935307de421623221520ee5d9ffab494af7f4b1945114fc7e4831856c75",
    "moveit_msgs/msg/WorkspaceParameters": "5001636b05e9fef44faf0220f88552cab9954e55dd3ab51075f448e9aa59186e",
    "moveit_msgs/srv/ApplyPlanningScene": "8e6134783db0987c0acedbfd2f16f608a8f7a54e83a7bbb372e851af419f4d72",
    "moveit_msgs/srv/GetCartesianPath": "b19f501df5d378141d918199894c3ad24533e76021a880b15dc5d62fec8d7b1a",
    "moveit_msgs/srv/GetGroupUrdf": "c163c6928521f2baf5e381b73f8ebdea4f2df895e643cb90de931a5319b8198c",
    "moveit_msgs/srv/GetMotionPlan": "0e118e1d8d53d5fea8eea309fc06a58239fa0e617864127e7de8399ab7335b27",
    "moveit_msgs/srv/GetPlannerParams": "770299091d17ec6f49840b0c5f9fee51a51508c0d5c4b5b561ec3b878fbbfa42",
    "moveit_msgs/srv/GetPlanningScene": "7ed7e96238b902174d985b0eb739ea08c95377e8e46a6a9014c22497faf79cd2",
    "moveit_msgs/srv/GetPositionFK": "2f16ec361a135d84b85a29385abeb9eeb025e39c09038bd6b2826645edc7edad",
    "moveit_msgs/srv/GetPositionIK": "054ed6f6f71a09b01b5246c5d80beb4dacc6f444f58df039849c76292933e9e3",
    "moveit_msgs/srv/GetStateValidity": "e9fcd24ae0fd8c2f16d4afe397efaf03427d1f899fe91ecf6cb7f7f1c6ca8720",
    "moveit_msgs/srv/QueryPlannerInterfaces": "c7550fca36d2ac8b3463b25c723baaf7ecd313d659d23d519c021b519e07b431",
    "moveit_msgs/srv/SetPlannerParams": "ad1d0693c449aaa77e5b55619af75e1b34bdcac05acbfcbcffd62819f9ac817d",
    "mujoco_ros2_control_msgs/srv/SetPause": "1986432cfda29853ee9fd682f7c3d5b39a5af49f3b15e54de4f0e5a0db46d082",
    "mujoco_ros2_control_msgs/srv/StepSimulation": "362a1ee77a9c33e2680f5d71c5fb73b487e574ed3b5e570f45ae7239bcaee3e7",
    "object_recognition_msgs/msg/ObjectType": "5eb3ee3976403366d7c50d7dbee8bec96b3bced1e752674a7194a35841632134",
    "octomap_msgs/msg/Octomap": "9891a19a05b70ec20aa8f45db3f8300b9ab80afff32c61c549d25087da9625b0",
    "octomap_msgs/msg/OctomapWithPose": "e65f8760aa96a2acef86b6d206175cfc78420082b6159dd3fa6ebf93f5f81979",
    "pal_statistics_msgs/msg/Statistic": "05b6302f2400f44bd8ea51df13137f60f11ba00937d663fdbb60626dfbf9dad7",
    "pal_statistics_msgs/msg/Statistics": "41f6fad7ef98ef8302d89fca17658d0e0b6922116bc01732a925e5c7339fd842",
    "pal_statistics_msgs/msg/StatisticsNames": "3b9f11f92019fa7b7bb20b885b18d89972d6836d3f8296fe5c6f87ed9b0f7b28",
    "pal_statistics_msgs/msg/StatisticsValues": "5227587e2d85c96fe55d619607437b847a1d65665a8e00aeb3b716bc56bd200a",
    "tf2_msgs/msg/TFMessage": "e369d0f05a23ae52508854b66f6aa0437f3449d652e8cbf22d5abe85d020f087",
}

# Nodes of users use these fields, so a change here breaks these nodes.
SORTING_CELL = {
    "apple_quality_msgs/msg/AppleQuality": "428f4fa8d4872d1dab7c4d192850d341346088906f3d27e4b87611882d62da6e",
    "apple_quality_msgs/msg/AppleQualityArray": "d41a4f298046db54b9b251cd868583ab6fd8055ad5e83d9bba615d48a4d0fec4",
    "sorting_arm_interfaces/action/PickPlace": "dadb5f5e48750b17ee478b4792091f83673a2f2c03bbd9b20b20cf7cc0346e81",
}

EXPECTED = PUBLIC | SORTING_CELL


def built_hashes(name: str) -> dict[str, str]:
    """Return the hashes of a type and of all types that it contains, by name, as stored in its build."""
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


# No hash of the types of the pick-and-place cell has been published, so their fields are compared with the description
# of the cell.
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
