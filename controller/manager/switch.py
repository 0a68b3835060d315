"""Plan a switch: decide which controllers to activate and deactivate, before any of them is changed."""

from collections.abc import Iterable, Mapping
from dataclasses import dataclass, field
from enum import IntEnum
from typing import Protocol

from controller.interface import Controller
from controller.manager.controller_spec import ControllerSpec
from controller.manager_errors import SwitchError
from hal.lifecycle import LifecycleState

DONE = "Successfully switched controllers!"
NOTHING = "After checking the controllers, no controllers need to be activated or deactivated."


class Strictness(IntEnum):
    """Strictness of a switch, using the values of the SwitchController service.

    STRICT fails if any part is impossible. BEST_EFFORT skips the impossible parts. AUTO is equivalent to BEST_EFFORT,
    because there are no chained controllers. FORCE_AUTO also deactivates controllers that claim a requested interface.
    """

    BEST_EFFORT = 1
    STRICT = 2
    AUTO = 3
    FORCE_AUTO = 4


@dataclass(frozen=True, slots=True)
class Loaded:
    """A loaded controller: its spec and, after configuration, the controller object."""

    spec: ControllerSpec
    state: LifecycleState = LifecycleState.UNCONFIGURED
    controller: Controller | None = None
    index: list[int] = field(default_factory=list)
    """Indices of the controller's commands among the commands of the hardware."""

    @property
    def name(self) -> str:
        return self.spec.name

    @property
    def active(self) -> bool:
        return self.state is LifecycleState.ACTIVE

    @property
    def configured(self) -> Controller:
        """The controller object of a configured entry."""
        assert self.controller is not None, f"{self.name} is unconfigured"
        return self.controller

    @property
    def commands(self) -> tuple[str, ...]:
        """Command interfaces of the controller; empty while it is unconfigured."""
        return self.controller.command_interfaces if self.controller else ()

    @property
    def states(self) -> tuple[str, ...]:
        """State interfaces of the controller; empty while it is unconfigured."""
        return self.controller.state_interfaces if self.controller else ()


@dataclass(frozen=True, slots=True)
class SwitchRequest:
    """Names of the controllers that a client wants to switch."""

    activate: tuple[str, ...] = ()
    deactivate: tuple[str, ...] = ()
    strictness: Strictness = Strictness.BEST_EFFORT


@dataclass(frozen=True, slots=True)
class SwitchPlan:
    """Names of the controllers that will be switched: first all of ``deactivate``, then all of ``activate``."""

    activate: tuple[str, ...]
    deactivate: tuple[str, ...]

    def summary(self) -> str:
        """Return the result of the switch, using the same message as ros2_control."""
        if not self.activate and not self.deactivate:
            return NOTHING
        parts = (("Deactivated", self.deactivate), ("Activated", self.activate))
        return "\n".join([DONE, *(f"{verb} controllers: [ {' '.join(names)} ]" for verb, names in parts if names)])


Loads = Mapping[str, Loaded]


class Interfaces(Protocol):
    """The interfaces of the hardware."""

    @property
    def command_interfaces(self) -> tuple[str, ...]:
        """Command interfaces, such as ``joint1/position``, in the order of the hardware's commands."""
        ...

    def ready(self, interface: str) -> bool:
        """Return whether a controller can currently use this command interface."""
        ...

    def measured(self, interface: str) -> bool:
        """Return whether a controller can currently use this state interface."""
        ...


def plan_switch(loaded: Loads, request: SwitchRequest, hardware: Interfaces) -> SwitchPlan:
    """Plan the part of a request that is possible. Raises SwitchError if nothing may be switched."""
    activate, deactivate = dict.fromkeys(request.activate), dict.fromkeys(request.deactivate)
    bad = {name: why for name in deactivate if (why := _why_not_deactivate(loaded, name))}
    bad |= {name: why for name in activate if (why := _why_not_activate(loaded, name, set(deactivate) - set(bad)))}
    unknown = not any(name in loaded for name in (*activate, *deactivate))
    if bad and (unknown or request.strictness is Strictness.STRICT):
        raise SwitchError("\n".join(bad.values()))
    start = tuple(name for name in activate if name not in bad)
    stop = tuple(name for name in deactivate if name not in bad)
    if request.strictness is Strictness.FORCE_AUTO:
        stop += _rivals(loaded, start, stop)
    _check_interfaces(loaded, start, stop, hardware)
    return SwitchPlan(start, stop)


def taken(loaded: Loads, without: Iterable[str] = ()) -> dict[str, str]:
    """Map each claimed command interface to the active controller that claims it, except controllers in ``without``."""
    excluded = set(without)
    return {
        claim: entry.name
        for entry in loaded.values()
        if entry.active and entry.name not in excluded
        for claim in entry.commands
    }


def _why_not_deactivate(loaded: Loads, name: str) -> str | None:
    if name not in loaded:
        return f"Could not deactivate controller with name '{name}' because no controller with this name exists"
    if not loaded[name].active:
        return f"Controller with name '{name}' can not be deactivated since it is not active."
    return None


def _why_not_activate(loaded: Loads, name: str, stopped: set[str]) -> str | None:
    if name not in loaded:
        return f"Could not activate controller with name '{name}' because no controller with this name exists"
    entry = loaded[name]
    if entry.active and name not in stopped:
        return f"Controller with name '{name}' is already active."
    if entry.controller is None:
        return (
            f"Controller with name '{name}' can not be activated since it is {entry.state.name.lower()}, "
            "not inactive: configure it first."
        )
    return None


def _rivals(loaded: Loads, start: tuple[str, ...], stop: tuple[str, ...]) -> tuple[str, ...]:
    """Return the active controllers that claim an interface of a controller in ``start``."""
    owners = taken(loaded, without=(*start, *stop))
    return tuple(dict.fromkeys(owners[claim] for name in start for claim in loaded[name].commands if claim in owners))


def _check_interfaces(loaded: Loads, start: tuple[str, ...], stop: tuple[str, ...], hardware: Interfaces) -> None:
    owners = taken(loaded, without=stop)
    for name in start:
        unable = f"Unable to activate controller '{name}' since the"
        commands = loaded[name].commands
        # A controller without commands may start before all its states are measured, to report the other joints.
        needs = (
            ("command", commands, hardware.ready),
            ("state", loaded[name].states if commands else (), hardware.measured),
        )
        for kind, interfaces, available in needs:
            for interface in interfaces:
                if not available(interface):
                    raise SwitchError(
                        f"{unable} {kind} interface '{interface}' is not available: "
                        "is its hardware component active? (ros2 control list_hardware_components)"
                    )
        for claim in loaded[name].commands:
            if claim in owners:
                raise SwitchError(f"{unable} command interface '{claim}' is currently claimed by another controller.")
            owners[claim] = name
