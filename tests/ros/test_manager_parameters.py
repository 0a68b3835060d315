"""Parameters of the manager, the controllers and the hardware component, through all parameter services."""

import math
from typing import Any

import pytest
from rcl_interfaces.msg import Parameter as ParameterMessage
from rcl_interfaces.msg import ParameterDescriptor, ParameterType, ParameterValue
from rcl_interfaces.srv import (
    DescribeParameters,
    GetParameterTypes,
    ListParameters,
    SetParameters,
    SetParametersAtomically,
)
from rclpy.parameter import Parameter

from tests.ros.manager_bench import AT_START, FORWARD
from tests.ros.manager_client import MANAGER, ManagerClient
from tests.ros.stack_process import StackProcess

ARM = "/arm_controller"
COMPONENT = "/robot_arm"
UNDECLARED = "parameter 'nonsense' cannot be set because it was not declared"
BOOL, INTEGER, DOUBLE, STRING, STRINGS = (
    ParameterType.PARAMETER_BOOL,
    ParameterType.PARAMETER_INTEGER,
    ParameterType.PARAMETER_DOUBLE,
    ParameterType.PARAMETER_STRING,
    ParameterType.PARAMETER_STRING_ARRAY,
)


def described(client: ManagerClient, node: str, *names: str) -> list[ParameterDescriptor]:
    return list(client.call(DescribeParameters, f"{node}/describe_parameters", names=list(names)).descriptors)


def listed(client: ManagerClient, node: str, prefix: str, depth: int) -> set[str]:
    return set(client.call(ListParameters, f"{node}/list_parameters", prefixes=[prefix], depth=depth).result.names)


def put_together(client: ManagerClient, node: str, **values: Any) -> str:
    """Set all parameters or none, and return the reason for a failure or ''. In keyword names, ``__`` represents a
    dot."""
    parameters = [Parameter(name.replace("__", "."), value=value).to_parameter_msg() for name, value in values.items()]
    result = client.call(SetParametersAtomically, f"{node}/set_parameters_atomically", parameters=parameters).result
    assert result.successful == (not result.reason)
    return str(result.reason)


def test_manager_has_its_parameters(client: ManagerClient) -> None:
    assert client.get(MANAGER, "update_rate", "conflict.type") == [20, FORWARD]
    assert "<ros2_control" in client.get(MANAGER, "robot_description")[0]
    assert client.put(MANAGER, "update_rate", 30) == "parameter 'update_rate' cannot be set because it is read-only"
    assert client.get(MANAGER, "update_rate") == [20]


def test_controllers_have_parameters_with_ros2_control_names(client: ManagerClient) -> None:
    names = client.parameters(ARM)
    assert {"joints", "constraints.goal_time", "constraints.joint1.goal", "interpolation_method"} <= names
    assert client.get("/spare", "joints", "interface_name") == [["joint6"], "position"]


# Services of all kinds of nodes


@pytest.mark.row("cm-parameter-services")
@pytest.mark.parametrize(
    ("node", "wanted"),
    [
        (MANAGER, {"update_rate": (INTEGER, True), "robot_description": (STRING, True), "spare.type": (STRING, False)}),
        (
            ARM,
            {
                "joints": (STRINGS, True),
                "interpolation_method": (STRING, True),
                "constraints.goal_time": (DOUBLE, False),
                "wait_for": (STRINGS, True),
            },
        ),
        (COMPONENT, {"use_sim_time": (BOOL, False)}),
    ],
)
def test_parameters_are_listed_described_and_typed(
    client: ManagerClient, node: str, wanted: dict[str, tuple[int, bool]]
) -> None:
    assert wanted.keys() <= client.parameters(node)
    found = described(client, node, *wanted)
    assert {d.name: (d.type, d.read_only) for d in found} == wanted
    types = client.call(GetParameterTypes, f"{node}/get_parameter_types", names=list(wanted)).types
    assert list(types) == [kind for kind, _ in wanted.values()]
    assert len(client.get(node, *wanted)) == len(wanted)


@pytest.mark.row("cm-parameter-services")
def test_description_contains_the_allowed_values(client: ManagerClient) -> None:
    (goal_time,) = described(client, ARM, "constraints.goal_time")
    assert goal_time.additional_constraints == "at least 0"


@pytest.mark.row("cm-parameter-services")
def test_groups_are_listed_by_their_prefix(client: ManagerClient) -> None:
    group = {"constraints.goal_time", "constraints.stopped_velocity_tolerance", "constraints.decelerate_on_cancel"}
    assert listed(client, ARM, "constraints", depth=1) == group
    deep = listed(client, ARM, "constraints", depth=ListParameters.Request.DEPTH_RECURSIVE)
    assert group | {"constraints.joint1.goal", "constraints.joint6.trajectory"} <= deep
    assert all(name.startswith("constraints.") for name in deep)
    assert listed(client, ARM, "nonsense", depth=1) == set()


@pytest.mark.row("cm-parameter-services")
@pytest.mark.parametrize("node", [ARM, COMPONENT])
def test_undeclared_parameter_is_neither_described_nor_set(client: ManagerClient, node: str) -> None:
    assert described(client, node, "use_sim_time", "nonsense") == []
    assert client.get(node, "use_sim_time", "nonsense") == []
    assert list(client.call(GetParameterTypes, f"{node}/get_parameter_types", names=["nonsense"]).types) == []
    assert client.put(node, "nonsense", 1.0) == UNDECLARED
    assert put_together(client, node, nonsense=1.0) == UNDECLARED
    assert "nonsense" not in client.parameters(node)


@pytest.mark.row("cm-parameter-services", "cm-spawner")
def test_manager_accepts_undeclared_parameters_of_the_spawner(client: ManagerClient) -> None:
    assert put_together(client, MANAGER, late__type=FORWARD, late__params_file=["a.yaml", "b.yaml"]) == ""
    assert client.get(MANAGER, "late.type", "late.params_file") == [FORWARD, ["a.yaml", "b.yaml"]]
    assert {d.name: d.type for d in described(client, MANAGER, "late.type", "late.params_file")} == {
        "late.type": STRING,
        "late.params_file": STRINGS,
    }


@pytest.mark.row("cm-parameter-services")
def test_unset_parameter_of_the_manager_has_no_value_and_type(client: ManagerClient) -> None:
    assert client.get(MANAGER, "nobody.type") == [None]
    assert list(client.call(GetParameterTypes, f"{MANAGER}/get_parameter_types", names=["nobody.type"]).types) == [0]
    assert [(d.name, d.type) for d in described(client, MANAGER, "nobody.type")] == [("nobody.type", 0)]


@pytest.mark.row("cm-parameter-services")
def test_atomic_call_sets_all_parameters_or_none(client: ManagerClient) -> None:
    names = ("constraints.goal_time", "constraints.joint1.goal")
    before = client.get(ARM, *names)
    refused = "constraints.joint1.goal: must be at least 0"
    assert refused in put_together(client, ARM, constraints__goal_time=2.5, constraints__joint1__goal=-0.5)
    assert client.get(ARM, *names) == before
    read_only = "parameter 'joints' cannot be set because it is read-only"
    assert put_together(client, ARM, constraints__goal_time=2.5, joints=["joint1"]) == read_only
    assert client.get(ARM, *names) == before
    assert put_together(client, ARM, constraints__goal_time=2.5, constraints__joint1__goal=0.5) == ""
    assert client.get(ARM, *names) == [2.5, 0.5]
    assert put_together(client, ARM, constraints__goal_time=before[0], constraints__joint1__goal=before[1]) == ""


@pytest.mark.row("cm-parameter-services")
def test_separate_call_sets_the_valid_parameters(client: ManagerClient) -> None:
    values = {"constraints.goal_time": 1.5, "joints": ["joint1"]}
    parameters = [Parameter(name, value=value).to_parameter_msg() for name, value in values.items()]
    results = client.call(SetParameters, f"{ARM}/set_parameters", parameters=parameters).results
    assert [result.successful for result in results] == [True, False]
    assert client.get(ARM, "constraints.goal_time") == [1.5]
    assert client.put(ARM, "constraints.goal_time", 0.0) == ""


# Refused values and preserved values


@pytest.mark.row("golden-read-only")
@pytest.mark.parametrize(("name", "value"), [("interpolation_method", "none"), ("joints", ["joint1"])])
def test_read_only_parameter_is_refused_with_the_ros2_control_text(
    client: ManagerClient, name: str, value: Any
) -> None:
    before = client.get(ARM, name)
    assert client.put(ARM, name, value) == f"parameter '{name}' cannot be set because it is read-only"
    assert client.get(ARM, name) == before


@pytest.mark.parametrize(
    ("name", "value", "reason"),
    [
        ("constraints.goal_time", -1.0, "constraints.goal_time: must be at least 0"),
        ("constraints.goal_time", float("nan"), "constraints.goal_time: must be a finite number"),
        ("constraints.joint1.goal", "wide", "Wrong parameter type, expected 'Type.DOUBLE' got 'Type.STRING'"),
        ("nonsense", 1.0, UNDECLARED),
    ],
)
def test_refused_parameter_keeps_its_value(client: ManagerClient, name: str, value: Any, reason: str) -> None:
    before = client.get(ARM, name)
    assert reason in client.put(ARM, name, value)
    assert client.get(ARM, name) == before


def test_set_parameter_survives_a_new_configuration(client: ManagerClient) -> None:
    assert client.put(ARM, "constraints.joint1.goal", 0.25) == ""
    assert client.switch((), ["arm_controller"])[0] and client.configure("arm_controller")
    assert client.get(ARM, "constraints.joint1.goal") == [0.25]
    assert client.put(ARM, "constraints.joint1.goal", 0.0) == ""
    assert client.switch(["arm_controller"])[0] and client.states() == AT_START


# Invalid values


def put_strange(client: ManagerClient, node: str) -> list[str]:
    """Return the reasons with which both services reject a value of type 77."""
    strange = ParameterMessage(name="use_sim_time", value=ParameterValue(type=77))
    (one,) = client.call(SetParameters, f"{node}/set_parameters", parameters=[strange]).results
    all_ = client.call(SetParametersAtomically, f"{node}/set_parameters_atomically", parameters=[strange]).result
    assert not one.successful and not all_.successful
    return [one.reason, all_.reason]


@pytest.mark.parametrize("node", [MANAGER, ARM, COMPONENT])
def test_value_of_an_unknown_type_is_answered(client: ManagerClient, stack: StackProcess, node: str) -> None:
    reason = "parameter 'use_sim_time' cannot be set because its type 77 does not exist: use 0 to 9"
    assert put_strange(client, node) == [reason, reason]
    assert "Traceback" not in stack.words


@pytest.mark.parametrize("wrong", [math.nan, 5, True, [1.0, 2.0], ["a/B"]])
def test_non_text_type_is_refused_and_the_controller_can_be_loaded(client: ManagerClient, wrong: Any) -> None:
    reason = client.put(MANAGER, "odd.type", wrong)
    assert reason.startswith("odd.type is ") and reason.endswith("not a controller type: write the type as a string")
    assert client.put(MANAGER, "odd.type", "no/Such") == "" and not client.load("odd")
    assert client.put(MANAGER, "odd.type", FORWARD) == "" and client.load("odd")


def test_setting_may_change_from_text_to_list(client: ManagerClient) -> None:
    for value in ("a.yaml", ["a.yaml", "b.yaml"], "c.yaml"):
        assert client.put(MANAGER, "other.params_file", value) == ""
        assert client.get(MANAGER, "other.params_file") == [value]
    assert client.put(MANAGER, "other.node_options_args", 5) == (
        "other.node_options_args is 5: use a string or a list of quoted strings"
    )
