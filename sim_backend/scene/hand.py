"""A person's hand on the simulated arm: it holds joints where they are, moves them, and lets them go.

It pushes with limited force at a limited speed, as a spring and a damper: against a stop it presses, and no more.
"""

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from typing import Any, Final, Protocol

from hal.plausible import range_mistake, without_truth

STRONGEST_NM: Final = 2.0
"""What the hand does to a joint at most."""
STIFFNESS_NM_RAD: Final = 40.0
DAMPING_NM_S: Final = 1.0
SPEED_RAD_S: Final = 1.0


class Pushable(Protocol):
    """What a hand needs of ``sim_backend.scene.world.World``."""

    @property
    def data(self) -> Any: ...

    @property
    def timestep_s(self) -> float: ...


@dataclass(slots=True)
class Grip:
    """One joint in the hand; ``reach`` is how many joint units a radian of its servo makes."""

    target: float
    reference: float
    reach: float


class Hand:
    """The hand; ``update`` belongs behind every step of the world. Positions in rad or m."""

    def __init__(self, world: Pushable, reach: Mapping[str, float]) -> None:
        """``reach``: joint units per radian of the servo's shaft, by joint; 1 for revolute joints."""
        self._world = world
        self._reach = dict(reach)
        self._grips: dict[str, Grip] = {}

    def hold(self, *joints: str) -> None:
        """Take joints (all of them, unless said) and keep them where they are."""
        for joint in joints or self._reach:
            here = self.position(joint)
            self._grips[joint] = Grip(here, here, self._reach[joint])

    def move(self, joint: str, position: float) -> None:
        """Take a joint there, at the hand's speed; it holds it then."""
        if joint not in self._grips:
            self.hold(joint)
        self._grips[joint].target = position

    def release(self, *joints: str) -> None:
        """Let joints go (all, unless said)."""
        for joint in joints or list(self._grips):
            self._grips.pop(joint, None)
            self._world.data.joint(joint).qfrc_applied = 0.0

    @property
    def joints(self) -> tuple[str, ...]:
        """All joints that it can take."""
        return tuple(self._reach)

    def holds(self, joint: str) -> bool:
        """Whether the hand has the joint."""
        return joint in self._grips

    def arrived(self, joint: str) -> bool:
        """Whether the hand has gone where it was to take the joint; a stop may have kept the joint itself behind."""
        return joint not in self._grips or self._grips[joint].reference == self._grips[joint].target

    def position(self, joint: str) -> float:
        """Where the joint is."""
        return float(self._world.data.joint(joint).qpos[0])

    def update(self) -> None:
        """One timestep of pushing."""
        for joint, grip in self._grips.items():
            step = SPEED_RAD_S * grip.reach * self._world.timestep_s
            way = grip.target - grip.reference
            grip.reference = grip.target if abs(way) <= step else grip.reference + (step if way > 0.0 else -step)
            self._push(joint, grip)

    def _push(self, joint: str, grip: Grip) -> None:
        data = self._world.data.joint(joint)
        behind = (grip.reference - float(data.qpos[0])) / grip.reach
        torque_nm = STIFFNESS_NM_RAD * behind - DAMPING_NM_S * float(data.qvel[0]) / grip.reach
        data.qfrc_applied = max(-STRONGEST_NM, min(torque_nm, STRONGEST_NM)) / grip.reach


def _position(value: Any) -> float:
    """A joint position of a command. Raises ValueError."""
    position = float(without_truth(value))
    if mistake := range_mistake("position", position):
        raise ValueError(mistake)
    return position


def obey(hand: Hand, lay_table: Callable[[], None], command: Mapping[str, Any]) -> dict[str, Any]:
    """Do what ``servoloop hand`` asks, and say where all joints are. ValueError for what a hand cannot do."""
    joints, what = command.get("joints", []), command.get("do")
    if unknown := [name for name in joints if name not in hand.joints]:
        raise ValueError(f"the arm has no joint {', '.join(unknown)}: it has {', '.join(hand.joints)}")
    if what == "hold":
        hand.hold(*joints)
    elif what == "release":
        hand.release(*joints)
    elif what == "move" and len(joints) == 1:
        hand.move(joints[0], _position(command["position"]))
    elif what == "lay":
        lay_table()
    elif what != "look":
        raise ValueError(f"a hand holds, releases, moves one joint to a position, lays the table or looks, not {what}")
    return {
        name: {"position": round(hand.position(name), 5), "held": hand.holds(name), "arrived": hand.arrived(name)}
        for name in hand.joints
    }
