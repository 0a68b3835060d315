"""Simulated hand of a person who moves the arm. The person's hand holds joints in place, moves them and releases them.

The hand acts like a spring with a damper, and its force and speed are limited. When a joint reaches a hard stop, the
hand merely presses against the stop.
"""

import math
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from typing import Any, Final, Protocol

from hal.plausible import range_mistake, without_truth

STRONGEST_NM: Final = 2.0
"""Maximum torque that the hand applies to a joint, in N m."""
STIFFNESS_NM_RAD: Final = 40.0
DAMPING_NM_S: Final = 1.0
SPEED_RAD_S: Final = 1.0
MARGIN_RAD: Final = math.pi
"""Maximum distance of a target beyond a hard stop, in radians of the servo's shaft."""


class Pushable(Protocol):
    """The part of ``sim_backend.scene.world.World`` that a hand uses."""

    @property
    def model(self) -> Any: ...

    @property
    def data(self) -> Any: ...

    @property
    def timestep_s(self) -> float: ...

    def push(self, joint: str, effort: float) -> None: ...


@dataclass(slots=True)
class GrippingJoint:
    """A joint that the hand holds. ``reach`` is the joint displacement per radian of its servo."""

    target: float
    reference: float
    reach: float


class SceneHand:
    """A person's hand. Call ``update`` after every step of the world. Positions are in rad or m."""

    def __init__(self, world: Pushable, reach: Mapping[str, float]) -> None:
        """Create a hand. ``reach`` contains the joint displacement per radian of the servo's shaft, keyed by joint
        name. The displacement is 1 for revolute joints."""
        self._world = world
        self._reach = dict(reach)
        self._grips: dict[str, GrippingJoint] = {}

    def hold(self, *joints: str) -> None:
        """Hold the given joints (by default, all joints) at their current positions."""
        for joint in joints or self._reach:
            here = self.position(joint)
            self._grips[joint] = GrippingJoint(here, here, self._reach[joint])

    def move(self, joint: str, position: float) -> None:
        """Move a joint to a position at the hand's speed, and then hold the joint."""
        if joint not in self._grips:
            self.hold(joint)
        self._grips[joint].target = position

    def release(self, *joints: str) -> None:
        """Release the given joints (by default, all joints)."""
        for joint in joints or list(self._grips):
            self._grips.pop(joint, None)
            self._world.push(joint, 0.0)

    @property
    def joints(self) -> tuple[str, ...]:
        """Names of all joints that the hand can hold."""
        return tuple(self._reach)

    def holds(self, joint: str) -> bool:
        """Return whether the hand holds the joint."""
        return joint in self._grips

    def arrived(self, joint: str) -> bool:
        """Return whether the hand has reached its target. The joint itself may not have reached the target because of a
        hard stop."""
        return joint not in self._grips or self._grips[joint].reference == self._grips[joint].target

    def position(self, joint: str) -> float:
        """Return the position of the joint."""
        return float(self._world.data.joint(joint).qpos[0])

    def range(self, joint: str) -> tuple[float, float]:
        """Return the range of the joint between its hard stops. A joint without stops has an infinite range."""
        described = self._world.model.joint(joint)
        lower, upper = map(float, described.range)
        return (lower, upper) if described.limited[0] else (-math.inf, math.inf)

    def margin(self, joint: str) -> float:
        """Return how far beyond a hard stop a target may be, to press against the stop."""
        return MARGIN_RAD * self._reach[joint]

    def update(self) -> None:
        """Apply the hand's force to the joints for one timestep."""
        for joint, grip in self._grips.items():
            step = SPEED_RAD_S * grip.reach * self._world.timestep_s
            way = grip.target - grip.reference
            grip.reference = grip.target if abs(way) <= step else grip.reference + (step if way > 0.0 else -step)
            self._push(joint, grip)

    def _push(self, joint: str, grip: GrippingJoint) -> None:
        data = self._world.data.joint(joint)
        behind = (grip.reference - float(data.qpos[0])) / grip.reach
        torque_nm = STIFFNESS_NM_RAD * behind - DAMPING_NM_S * float(data.qvel[0]) / grip.reach
        self._world.push(joint, max(-STRONGEST_NM, min(torque_nm, STRONGEST_NM)) / grip.reach)


def _position(value: Any) -> float:
    """Check the joint position of a command. Raises ValueError."""
    position = float(without_truth(value))
    if mistake := range_mistake("position", position):
        raise ValueError(mistake)
    return position


def _within_reach(hand: SceneHand, joint: str, position: float) -> float:
    """Check that a position is close to the range of its joint. Raises ValueError."""
    lower, upper = hand.range(joint)
    if not lower - hand.margin(joint) <= position <= upper + hand.margin(joint):
        raise ValueError(
            f"{position:g} is far outside the range of {joint}, {lower:.3f} to {upper:.3f}: pass a position in rad or m"
        )
    return position


def handle_hand_command(hand: SceneHand, lay_table: Callable[[], None], command: Mapping[str, Any]) -> dict[str, Any]:
    """Execute a command of ``servoloop hand`` and return the state of all joints.

    Raises ValueError for invalid commands.
    """
    joints, what = command.get("joints", []), command.get("do")
    if unknown := [name for name in joints if name not in hand.joints]:
        raise ValueError(f"the arm has no joint {', '.join(unknown)}: its joints are {', '.join(hand.joints)}")
    if what == "hold":
        hand.hold(*joints)
    elif what == "release":
        hand.release(*joints)
    elif what == "move" and len(joints) == 1:
        hand.move(joints[0], _within_reach(hand, joints[0], _position(command["position"])))
    elif what == "lay":
        lay_table()
    elif what in ("connect", "disconnect"):
        raise ValueError(f"{what} needs a box of servos: start the emulator with 'servoloop emulate LINK --box'")
    elif what != "look":
        raise ValueError(f"do must be hold, release, move (one joint to a position), lay or look, not {what}")
    return {
        name: {"position": round(hand.position(name), 5), "held": hand.holds(name), "arrived": hand.arrived(name)}
        for name in (joints if what == "look" and joints else hand.joints)
    }
