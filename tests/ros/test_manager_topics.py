"""Lists and published topics of the controller manager, as seen from another process."""

from itertools import groupby

import pytest
from controller_manager_msgs.msg import ControllerManagerActivity
from controller_manager_msgs.srv import ListControllerTypes, ListHardwareComponents
from diagnostic_msgs.msg import DiagnosticArray
from lifecycle_msgs.msg import TransitionEvent
from rclpy.qos import DurabilityPolicy, QoSProfile, ReliabilityPolicy
from std_msgs.msg import String

from servoloop.stack.shipped_files import URDF
from tests.ros.manager_bench import AT_START, FORWARD
from tests.ros.manager_client import MANAGER, ManagerClient
from tests.ros.stack_process import StackProcess

LATCHED = QoSProfile(depth=10, durability=DurabilityPolicy.TRANSIENT_LOCAL)
INACTIVE, ACTIVE = (2, "inactive"), (3, "active")


# Lists


@pytest.mark.row("cm-list-controllers")
def test_list_controllers_returns_all_controllers(client: ManagerClient) -> None:
    assert client.cleanup("spare")
    listed = client.listed()
    arm, conflict, spare = listed["arm_controller"], listed["conflict"], listed["spare"]
    joints = [f"joint{i}/position" for i in range(1, 7)]
    assert (arm.type, arm.update_rate) == ("joint_trajectory_controller/JointTrajectoryController", 20)
    assert (arm.claimed_interfaces, arm.required_command_interfaces) == (joints, joints)
    assert sorted(arm.required_state_interfaces) == sorted([*joints, *(f"joint{i}/velocity" for i in range(1, 7))])
    assert (conflict.claimed_interfaces, conflict.required_command_interfaces) == ([], ["joint1/position"])
    assert (spare.state, spare.required_command_interfaces, spare.required_state_interfaces) == ("unconfigured", [], [])
    for c in listed.values():
        assert not (c.is_async or c.is_chainable or c.is_chained)
        assert c.reference_interfaces == c.exported_state_interfaces == c.chain_connections == []


@pytest.mark.row("cm-list-controllers")
def test_claims_are_listed_while_active_and_requirements_while_configured(client: ManagerClient) -> None:
    def hand() -> tuple[str, list[str], list[str]]:
        listed = client.listed()["hand_controller"]
        return listed.state, list(listed.claimed_interfaces), list(listed.required_command_interfaces)

    finger = ["hand_right_joint/position"]
    assert hand() == ("active", finger, finger)
    assert client.switch((), ["hand_controller"])[0]
    assert hand() == ("inactive", [], finger)
    assert client.cleanup("hand_controller")
    assert hand() == ("unconfigured", [], [])
    assert client.configure("hand_controller")
    assert hand() == ("inactive", [], finger)


def test_list_controller_types_returns_all_types(client: ManagerClient) -> None:
    answer = client.call(ListControllerTypes, f"{MANAGER}/list_controller_types")
    assert {FORWARD, "joint_state_broadcaster/JointStateBroadcaster"} <= set(answer.types)
    assert answer.base_classes == ["controller_interface::ControllerInterface"] * len(answer.types)


# Published topics


@pytest.mark.row("cm-activity")
def test_activity_is_latched_and_published_on_every_change(client: ManagerClient) -> None:
    (publisher,) = client.node.get_publishers_info_by_topic(f"{MANAGER}/activity")
    assert publisher.qos_profile.reliability is ReliabilityPolicy.RELIABLE
    assert publisher.qos_profile.durability is DurabilityPolicy.TRANSIENT_LOCAL
    everything = {**AT_START, "robot_arm": "active"}
    with client.hearing(ControllerManagerActivity, f"{MANAGER}/activity", LATCHED) as heard:

        def states() -> list[dict[str, str]]:
            return [{c.name: c.state.label for c in (*m.controllers, *m.hardware_components)} for m in heard]

        client.spin_until(lambda: heard)
        assert states() == [everything]  # Without a change, nothing is published again.
        assert client.switch((), ["hand_controller"])[0] and client.cleanup("hand_controller")
        assert client.unload("hand_controller") and client.load("hand_controller")
        assert client.configure("hand_controller") and client.switch(["hand_controller"])[0]
        client.set_hardware("inactive")
        client.spin_until(lambda: states()[-1]["robot_arm"] == "inactive")
        client.set_hardware("active")
        client.spin_until(lambda: states()[-1]["robot_arm"] == "active")
        told = [message.get("hand_controller") for message in states()]
        way = ["active", "inactive", "unconfigured", None, "unconfigured", "inactive", "active", "inactive"]
        assert [state for state, _ in groupby(told)] == way
        stamps_s = [m.header.stamp.sec + m.header.stamp.nanosec * 1e-9 for m in heard]
        assert stamps_s == sorted(stamps_s)


def test_transitions_are_published_as_in_ros2_control(client: ManagerClient) -> None:
    with client.hearing(TransitionEvent, "/hand_controller/transition_event") as heard:
        assert client.switch((), ["hand_controller"])[0]
        client.spin_until(lambda: len(heard) >= 2)
        assert client.switch(["hand_controller"], ())[0]
        client.spin_until(lambda: len(heard) >= 4)
    activating, deactivating = (13, "activating"), (14, "deactivating")
    seen = [[(part.id, part.label) for part in (m.transition, m.start_state, m.goal_state)] for m in heard]
    assert seen == [
        [(4, "deactivate"), ACTIVE, deactivating],
        [(40, "transition_success"), deactivating, INACTIVE],
        [(3, "activate"), INACTIVE, activating],
        [(30, "transition_success"), activating, ACTIVE],
    ]


@pytest.mark.row("cm-diagnostics")
def test_diagnostics_are_published_once_per_second(client: ManagerClient) -> None:
    with client.hearing(DiagnosticArray, "/diagnostics") as heard:
        client.spin_until(lambda: len(heard) >= 4)
    stamps_s = [m.header.stamp.sec + m.header.stamp.nanosec * 1e-9 for m in heard]
    assert (stamps_s[-1] - stamps_s[0]) / (len(stamps_s) - 1) == pytest.approx(1.0, abs=0.2)
    statuses = {status.name: status for status in heard[-1].status}
    loop, arm = statuses["servoloop: control loop"], statuses["servoloop: robot_arm"]
    assert {value.key: value.value for value in loop.values}["rate_hz"] == "20"
    assert (arm.level, arm.message) == (b"\x00", "active")


@pytest.mark.row("cm-description")
def test_different_description_is_ignored_with_a_warning(client: ManagerClient, stack: StackProcess) -> None:
    """The description in use is set at the start. The robot state publisher of the stack latches the same
    description."""
    warning = "a different robot description on /robot_description is ignored"
    assert client.get(MANAGER, "robot_description") == [URDF.read_text()]
    assert warning not in stack.words
    publisher = client.node.create_publisher(String, "/robot_description", LATCHED)
    publisher.publish(String(data="<robot name='another'/>"))
    client.spin_until(lambda: warning in stack.words)
    client.node.destroy_publisher(publisher)
    refused = "parameter 'robot_description' cannot be set because it is read-only"
    assert client.put(MANAGER, "robot_description", "<robot name='another'/>") == refused
    assert client.get(MANAGER, "robot_description") == [URDF.read_text()]
    (component,) = client.call(ListHardwareComponents, f"{MANAGER}/list_hardware_components").component
    assert (component.name, component.state.label) == ("robot_arm", "active")
    assert client.states() == AT_START
