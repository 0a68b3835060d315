"""Puppet controllers for tests, and a manager of three joints."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from controller.manager.controller_spec import ControllerSpec
from controller.manager.manager import ControllerManager
from controller.parameters import Parameters
from hal.types import FloatArray, JointLimits, JointState

JOINTS = ("a", "b", "c")
HELD = np.array([0.1, 0.2, 0.3])
STANDING = JointState(0.0, np.zeros(3), np.zeros(3), np.zeros(3))


@dataclass
class Interfaces:
    """Interfaces of hardware on which all interfaces except those in ``lost`` are available."""

    command_interfaces: tuple[str, ...] = tuple(f"{joint}/position" for joint in JOINTS)
    lost: str | None = None

    def ready(self, interface: str) -> bool:
        return interface != self.lost

    def measured(self, interface: str) -> bool:
        return interface != self.lost


class Puppet:
    """Controller that commands the value ``wanted`` for each of its joints. ``failing`` lists the calls that raise an
    error."""

    kind = "test/Puppet"
    parameters = Parameters()

    def __init__(self, name: str, *joints: str, wanted: float = 0.7, failing: Sequence[str] = ()) -> None:
        self.name = name
        self.command_interfaces = tuple(f"{joint}/position" for joint in joints)
        self.state_interfaces = tuple(f"{joint}/velocity" for joint in joints)
        self.command: FloatArray = np.full(len(joints), np.nan)
        self.wanted = wanted
        self.failing = set(failing)
        self.calls: list[str] = []

    def activate(self, state: JointState, command: FloatArray) -> None:
        self._called("activate")
        self.command = command.copy()

    def deactivate(self, reason: str = "") -> None:
        self._called("deactivate")

    def update(self, state: JointState, now_s: float, period_s: float) -> None:
        self._called("update")
        self.command = np.full(len(self.command_interfaces), self.wanted)

    def settled(self) -> bool:
        return False

    def _called(self, what: str) -> None:
        self.calls.append(what)
        if what in self.failing:
            raise RuntimeError(f"{self.name} is broken")


def managing(
    *puppets: Puppet,
    active: Sequence[str] = (),
    fallback: dict[str, tuple[str, ...]] | None = None,
    limits: Mapping[str, JointLimits] | None = None,
    hardware: Interfaces | None = None,
) -> ControllerManager:
    """Return a manager of joints at rest, with these controllers. Only the controllers in ``active`` are active."""
    made = ControllerManager(hardware or Interfaces(), limits or {})
    made.activate(STANDING, HELD)
    for puppet in puppets:
        made.registry.load(
            ControllerSpec(puppet.name, puppet.kind, puppet.parameters, (fallback or {}).get(puppet.name, ()))
        )
        made.registry.configure(puppet.name, puppet)
    if active:
        from controller.manager.switch import Strictness, SwitchRequest

        made.switch(SwitchRequest(tuple(active), strictness=Strictness.STRICT), HELD)
    return made


def cycle(manager: ControllerManager, last: FloatArray = HELD) -> list[float]:
    """Run one cycle and return the commands of the three joints."""
    wanted: list[float] = manager.cycle.update(STANDING, last, 0.0, 0.05).tolist()
    return wanted
