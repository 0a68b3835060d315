"""Test the values of /joint_states and /dynamic_joint_states."""

import dataclasses
from collections.abc import Mapping
from typing import Any

import numpy as np
import pytest

from controller.broadcasters.joint_state_broadcaster import BroadcasterParameters, JointStateBroadcaster, JointStates
from controller.interface import ControllerContext
from drivers.bus.counters import ServoCounters
from hal.robot_description.description import Description, HardwareInfo, Mimic, UrdfJoint
from hal.types import JointLimits, JointState, ServoHealth

ALL = ("position", "velocity", "effort")
NAN = float("nan")
INTERFACES = {
    "wrist": ("position", "temperature"),
    "base": ALL,
    "left": ("position", "velocity"),
    "right": ("position", "velocity"),
    "lamp": ("voltage",),
}
HARDWARE = ("base", "wrist", "right")
LIMITS = {"base": JointLimits(-2.0, 2.0, 4.0, 12.0, 120.0), "right": JointLimits(-1.0, 4.0, 4.0, 12.0, 120.0)}


def broadcaster(**parameters: Any) -> JointStateBroadcaster:
    mimics = {"left": Mimic("right", -2.0, 0.1)}
    return JointStateBroadcaster("jsb", BroadcasterParameters(**parameters), INTERFACES, mimics, HARDWARE, LIMITS)


def state(stamp_s: float = 7.0) -> JointState:
    health = {"wrist": ServoHealth(11.5, 41.0, ("overload",), ServoCounters(replies=9, silent=1), 0.25)}
    return JointState(
        stamp_s,
        np.array([1.0, 2.0, 3.0]),
        np.array([0.1, 0.2, 0.3]),
        np.array([10.0, 20.0, 30.0]),
        health=health,
        extra={"lamp/voltage": 0.5},
    )


def sampled(**parameters: Any) -> JointStates:
    return broadcaster(**parameters).sample(state())


def test_joints_are_sorted_mimics_are_computed_and_missing_values_are_nan() -> None:
    sample = sampled()
    assert sample.stamp_s == 7.0
    assert sample.names == ("base", "left", "right", "wrist")
    np.testing.assert_allclose(sample.position, [1.0, -5.9, 3.0, 2.0])
    np.testing.assert_allclose(sample.velocity, [0.1, -0.6, 0.3, np.nan])
    np.testing.assert_allclose(sample.effort, [10.0, np.nan, np.nan, np.nan])


@pytest.mark.parametrize(
    ("parameters", "names", "velocity"),
    [
        ({}, ("base", "left", "right", "wrist"), [0.1, -0.6, 0.3, NAN]),
        ({"use_urdf_to_filter": False}, ("wrist", "base", "left", "right"), [NAN, 0.1, -0.6, 0.3]),
        ({"joints": ["right", "base"], "interfaces": ["velocity"]}, ("right", "base"), [0.3, 0.1]),
        ({"joints": ["right", "base"], "interfaces": ["position"]}, ("right", "base"), [NAN, NAN]),
        ({"joints": ["right"]}, ("base", "left", "right", "wrist"), [0.1, -0.6, 0.3, NAN]),
        ({"interfaces": ["position"]}, ("base", "left", "right", "wrist"), [0.1, -0.6, 0.3, NAN]),
        (
            {"extra_joints": ["z", "a", "base"]},
            ("base", "left", "right", "wrist", "z", "a"),
            [0.1, -0.6, 0.3, NAN, 0, 0],
        ),
        (
            {"joints": ["base"], "interfaces": ["velocity"], "extra_joints": ["wheel"]},
            ("base", "wheel"),
            [0.1, 0.0],
        ),
    ],
    ids=["all", "no URDF order", "chosen", "chosen, not these", "only joints", "only interfaces", "extra", "both"],
)
def test_joints_and_their_order_match_ros2_control(
    parameters: dict[str, Any], names: tuple[str, ...], velocity: list[float]
) -> None:
    sample = sampled(**parameters)
    assert sample.names == names
    np.testing.assert_allclose(sample.velocity, velocity)
    assert len(sample.position) == len(sample.effort) == len(names)


def test_a_missing_interface_is_rejected_with_the_existing_ones() -> None:
    with pytest.raises(
        ValueError, match=r"the URDF has no state interface wrist/velocity, wrist/effort: .*base/effort"
    ):
        broadcaster(joints=["wrist"], interfaces=["position", "velocity", "effort"])


def test_fields_can_be_filled_from_other_interfaces() -> None:
    sample = sampled(map_interface_to_joint_state={"effort": "temperature"})
    np.testing.assert_allclose(sample.effort, [NAN, NAN, NAN, 41.0])
    np.testing.assert_allclose(sample.position, [1.0, -5.9, 3.0, 2.0])


def test_a_joint_with_only_a_mapped_interface_is_published() -> None:
    sample = sampled(map_interface_to_joint_state={"effort": "voltage"})
    assert "lamp" in sample.names


def test_a_requested_interface_is_not_mapped() -> None:
    sample = sampled(
        joints=["base"], interfaces=["effort", "velocity"], map_interface_to_joint_state={"effort": "velocity"}
    )
    assert sample.effort == [10.0]


def test_a_mapping_applies_if_only_joints_or_only_interfaces_are_set() -> None:
    controller = broadcaster(interfaces=["effort"], map_interface_to_joint_state={"effort": "velocity"})
    sample = controller.sample(state())
    np.testing.assert_allclose(sample.effort, [0.1, -0.6, 0.3, NAN])
    assert controller.parameters.unused() == ["interfaces (joints and interfaces must be set together)"]


def test_mimic_joints_of_the_urdf_are_used_if_the_hardware_has_them() -> None:
    def joint(name: str, mimic: Mimic | None) -> UrdfJoint:
        return UrdfJoint(name, "prismatic", "a", name, (0, 0, 0), (0, 0, 0), (1, 0, 0), 0.0, 1.0, 1.0, mimic)

    joints = {"right": joint("right", None), "left": joint("left", Mimic("right", -2.0, 0.1))}
    states = {"right": ("position",), "left": ("position",)}

    def positions(commands: Mapping[str, tuple[str, ...]], mimics: frozenset[str], *measured: float) -> list[float]:
        component = HardwareInfo("hand", "system", "mock", {}, commands, states, mimics)
        context = ControllerContext(Description("", joints), component, {}, lambda name: True)
        made = JointStateBroadcaster.build("jsb", BroadcasterParameters(), context)
        still = np.zeros(len(measured))
        sample = made.sample(JointState(0.0, np.array(measured), still, still))
        assert sample.names == ("left", "right")
        return [float(value) for value in sample.position]

    both = {"right": ("position",), "left": ("position",)}
    assert positions({"right": ("position",), "left": ()}, frozenset({"left"}), 3.0) == pytest.approx([-5.9, 3.0])
    assert positions(both, frozenset(), 3.0, 4.0) == [4.0, 3.0]


@pytest.mark.parametrize(
    ("parameters", "unused"),
    [
        ({}, []),
        ({"joints": ["base"]}, ["joints (joints and interfaces must be set together)"]),
        ({"interfaces": ["position"]}, ["interfaces (joints and interfaces must be set together)"]),
        ({"update_rate": 50}, ["update_rate"]),
        (
            {"joints": ["base"], "interfaces": ["effort"], "map_interface_to_joint_state": {"effort": "load"}},
            ["map_interface_to_joint_state.effort (effort itself is listed in interfaces)"],
        ),
    ],
)
def test_parameters_without_effect_are_listed(parameters: dict[str, Any], unused: list[str]) -> None:
    assert BroadcasterParameters(**parameters).unused() == unused


def test_dynamic_joint_states_include_the_interfaces_of_the_servo() -> None:
    controller = broadcaster(extra_joints=["wheel"])
    assert dict(controller.interfaces) == {
        "base": ALL,
        "lamp": ("voltage",),
        "left": ("position", "velocity"),
        "right": ("position", "velocity"),
        "wrist": ("position", "temperature"),
        "wheel": ALL,
    }
    values = controller.values(state())
    wanted = [[1.0, 0.1, 10.0], [0.5], [-5.9, -0.6], [3.0, 0.3], [2.0, 41.0], [0.0, 0.0, 0.0]]
    for seen, expected in zip(values, wanted, strict=True):
        np.testing.assert_allclose(seen, expected)


def test_the_broadcaster_claims_nothing_and_is_always_settled() -> None:
    controller = broadcaster()
    assert controller.command_interfaces == ()
    assert controller.command.shape == (0,)
    assert controller.settled()


def test_every_cycle_is_a_new_sample() -> None:
    controller, now = broadcaster(), state()
    assert controller.sample(now) is controller.sample(now)
    assert controller.sample(state(7.05)).stamp_s == 7.05
    assert controller.sample(now).stamp_s == 7.0


def test_a_reactivated_broadcaster_has_no_old_state() -> None:
    controller = broadcaster()
    controller.update(state(), 7.0, 0.05)
    assert controller.state is not None
    controller.deactivate()
    assert controller.state is None
    controller.update(state(), 7.0, 0.05)
    controller.activate(state(), np.empty(0))
    assert controller.state is None


@pytest.mark.parametrize(
    ("measured", "reported"),
    [
        (
            (2.0008, 9.0, -1.004),
            (2.0, 2.1, -1.0, 9.0),
        ),  # The mimic joint follows the reported position. The wrist has no limits.
        ((-2.003, 9.0, 4.0), (-2.0, -7.9, 4.0, 9.0)),
        (
            (2.005, 9.0, -1.006),
            (2.005, 2.112, -1.006, 9.0),
        ),  # The position is further outside than sag and the resolution of the encoder can explain.
    ],
)
def test_a_joint_slightly_beyond_its_limit_is_reported_at_the_limit(
    measured: tuple[float, ...], reported: tuple[float, ...]
) -> None:
    ours = broadcaster()
    beyond = dataclasses.replace(state(), position=np.array(measured))
    np.testing.assert_allclose(ours.sample(beyond).position, reported, atol=1e-12)
    assert ours.values(beyond)[list(ours.interfaces).index("base")][0] == measured[0]
