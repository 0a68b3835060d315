"""Hardware components over ROS: listed, switched, lost and recovered by a client in another process."""

import math
from collections.abc import Iterator

import pytest
from controller_manager_msgs.srv import ListHardwareComponents, ListHardwareInterfaces, SetHardwareComponentState
from lifecycle_msgs.msg import State
from sensor_msgs.msg import JointState

from tests.ros.hardware_client import activate, ask, components, controllers, set_state
from tests.ros.stack_process import READY, ArmClient, StackProcess, arm_client, running
from tests.ros.two_components import ARM, HAND, write_urdf

ABORTED = 6  # action_msgs/msg/GoalStatus


@pytest.fixture(scope="module")
def stack(ros_domain: int, tmp_path_factory: pytest.TempPathFactory) -> Iterator[StackProcess]:
    folder = tmp_path_factory.mktemp("mock")
    with running(folder, "--urdf", str(write_urdf(folder))) as stack:
        yield stack


@pytest.fixture(scope="module")
def client(stack: StackProcess) -> Iterator[ArmClient]:
    with arm_client() as client:
        yield client


@pytest.fixture(autouse=True)
def everything_active(request: pytest.FixtureRequest) -> None:
    """Restore the state before each test that uses the mocks."""
    if "client" in request.fixturenames:
        client = request.getfixturevalue("client")
        for name in ("arm", "hand"):
            assert set_state(client, name, State.PRIMARY_STATE_ACTIVE) == (True, "active")
        idle = [name for name, state in controllers(client).items() if state != "active"]
        assert not idle or activate(client, *idle)[0]


@pytest.mark.row("cm-list-hardware")
def test_both_components_are_listed_as_in_the_file(client: ArmClient) -> None:
    arm, hand = ask(client, ListHardwareComponents, "list_hardware_components").component
    assert (arm.name, arm.type, arm.plugin_name) == ("arm", "system", "mock_components/GenericSystem")
    assert (arm.rw_rate, hand.rw_rate) == (20, 10)
    assert (arm.state.id, arm.state.label) == (State.PRIMARY_STATE_ACTIVE, "active")
    assert [i.name for i in hand.command_interfaces] == [f"{HAND}/position"]
    assert [i.name for i in hand.state_interfaces] == [
        f"{joint}/{kind}" for joint in (HAND, "hand_left_joint") for kind in ("position", "velocity")
    ]
    assert all(i.is_available and i.is_claimed for i in arm.command_interfaces)
    assert all(i.is_available and not i.is_claimed for i in arm.state_interfaces)
    everything = (*arm.command_interfaces, *arm.state_interfaces, *hand.command_interfaces, *hand.state_interfaces)
    assert {i.data_type for i in everything} == {"double"}
    assert len(everything) == 6 + 12 + 1 + 4


ROWS = [
    # States to set in order (ID and label), and the expected response to the last request.
    ([(State.PRIMARY_STATE_INACTIVE, "")], (True, "inactive")),
    ([(State.PRIMARY_STATE_UNCONFIGURED, "")], (True, "unconfigured")),
    ([(0, "inactive")], (True, "inactive")),
    ([(0, "unconfigured"), (0, "active")], (True, "active")),
    ([(0, "unconfigured"), (0, "inactive")], (True, "inactive")),
    ([(0, "inactive"), (0, "active")], (True, "active")),
    ([(0, "active")], (True, "active")),
    ([(State.PRIMARY_STATE_INACTIVE, "active")], (True, "inactive")),
    ([(0, "asleep")], (False, "active")),
    ([(0, "")], (False, "active")),
    ([(77, "active")], (False, "active")),
]


@pytest.mark.row("cm-set-hardware")
@pytest.mark.parametrize(("steps", "answer"), ROWS)
def test_hardware_state_can_be_set(client: ArmClient, steps: list[tuple[int, str]], answer: tuple[bool, str]) -> None:
    for target, label in steps:
        got = set_state(client, "hand", target, label)
    assert got == answer
    assert components(client) == {"arm": "active", "hand": answer[1]}


def test_unknown_component_is_refused(client: ArmClient) -> None:
    assert set_state(client, "foot", State.PRIMARY_STATE_ACTIVE)[0] is False


@pytest.mark.row("cm-list-hardware")
@pytest.mark.parametrize(("label", "available"), [("active", True), ("inactive", True), ("unconfigured", False)])
def test_interfaces_are_available_while_configured(client: ArmClient, label: str, available: bool) -> None:
    assert set_state(client, "hand", label=label) == (True, label)
    answer = ask(client, ListHardwareInterfaces, "list_hardware_interfaces")
    hand = [i for i in (*answer.command_interfaces, *answer.state_interfaces) if i.name.startswith("hand")]
    arm = [i for i in (*answer.command_interfaces, *answer.state_interfaces) if i.name.startswith("joint")]
    assert [i.is_available for i in hand] == [available] * 5
    assert all(i.is_available for i in arm)
    assert {i.name: i.is_claimed for i in answer.command_interfaces}[f"{HAND}/position"] == (label == "active")


@pytest.mark.row("trouble-nan")
def test_joints_of_unconfigured_hardware_are_not_in_joint_states(client: ArmClient) -> None:
    messages: list[JointState] = []
    client.node.create_subscription(JointState, "/joint_states", messages.append, 100)
    for label, names in (("unconfigured", [*ARM]), ("active", ["hand_left_joint", HAND, *ARM])):
        assert set_state(client, "hand", label=label) == (True, label)
        client.spin_until(lambda names=names: bool(messages) and messages[-1].name == names)
    assert all(len(m.name) == len(m.position) == len(m.velocity) == len(m.effort) for m in messages)
    assert all(math.isfinite(value) for message in messages for value in message.position)


@pytest.mark.row("trouble-deactivated")
def test_controllers_are_deactivated_with_their_hardware_until_it_is_active(client: ArmClient) -> None:
    """In contrast, the controllers of ros2_control remain active without effect."""
    set_state(client, "hand", label="inactive")
    states = controllers(client)
    assert (states["hand_controller"], states["arm_controller"], states["joint_state_broadcaster"]) == (
        "inactive",
        "active",
        "active",
    )
    ok, message = activate(client, "hand_controller")
    assert not ok
    assert f"command interface '{HAND}/position' is not available" in message
    set_state(client, "hand", label="active")
    assert activate(client, "hand_controller")[0]


@pytest.mark.row("golden-hardware-inactive", "trouble-deactivated")
def test_goal_is_aborted_when_its_hardware_is_set_inactive(client: ArmClient) -> None:
    """In contrast, the goal succeeds in ros2_control without any motion."""
    result = client.send([0.3, *READY[1:]], seconds=5)
    assert set_state(client, "arm", label="inactive") == (True, "inactive")
    answer = client.wait(result)
    assert answer.status == ABORTED
    text = "Current goal cancelled during deactivate transition."
    assert answer.result.error_string == f"{text} arm is being set to inactive"
    assert controllers(client)["hand_controller"] == "active"


def test_burst_of_state_requests_ends_in_the_last_state(client: ArmClient) -> None:
    service = client.node.create_client(SetHardwareComponentState, "/controller_manager/set_hardware_component_state")
    assert service.wait_for_service(30.0)
    # The default service profile queues ten requests and ten responses. If more than ten are sent at a time, some may
    # be lost.
    labels = ["inactive", "unconfigured", "active", "inactive"] * 2
    wishes = [SetHardwareComponentState.Request(name="hand", target_state=State(label=label)) for label in labels]
    for _ in range(5):
        answers = [client.wait(future) for future in [service.call_async(wish) for wish in wishes]]
        assert [answer.ok for answer in answers] == [True] * len(labels)
    assert components(client)["hand"] == "inactive"
