"""A switch is planned here: which controllers it starts and stops, decided before anything is touched. Pure."""

from collections.abc import Iterable, Mapping
from dataclasses import dataclass, field
from enum import IntEnum
from typing import Protocol

from controller.interface import Controller
from controller.manager.controller_spec import ControllerSpec
from hal.lifecycle import LifecycleState

DONE = "Successfully switched controllers!"
NOTHING = "After checking the controllers, no controllers need to be activated or deactivated."


class ManagerError(Exception):
    """The manager refuses: the text says why, and what to do."""


class SwitchError(ManagerError):
    """Nothing was switched."""


class Strictness(IntEnum):
    """The strictness says how much of a switch must be possible for any of it to happen; values of SwitchController.

    BEST_EFFORT drops impossible parts. AUTO would also switch chained controllers, of which there are none, and is the
    same. FORCE_AUTO also stops controllers that claim a wanted interface.
    """

    BEST_EFFORT = 1
    STRICT = 2
    AUTO = 3
    FORCE_AUTO = 4


@dataclass(frozen=True, slots=True)
class Loaded:
    """A controller as the manager has it: its spec, and from its configuration on the controller itself."""

    spec: ControllerSpec
    state: LifecycleState = LifecycleState.UNCONFIGURED
    controller: Controller | None = None
    index: list[int] = field(default_factory=list)
    """The places of its commands among the hardware's."""

    @property
    def name(self) -> str:
        return self.spec.name

    @property
    def active(self) -> bool:
        return self.state is LifecycleState.ACTIVE

    @property
    def configured(self) -> Controller:
        """Its controller, where it is known to be configured."""
        assert self.controller is not None, f"{self.name} is unconfigured"
        return self.controller

    @property
    def commands(self) -> tuple[str, ...]:
        """The command interfaces that it needs; none while it is unconfigured."""
        return self.controller.command_interfaces if self.controller else ()

    @property
    def states(self) -> tuple[str, ...]:
        """The state interfaces that it needs; none while it is unconfigured."""
        return self.controller.state_interfaces if self.controller else ()


@dataclass(frozen=True, slots=True)
class SwitchRequest:
    """The controllers that a client wants switched, by name."""

    activate: tuple[str, ...] = ()
    deactivate: tuple[str, ...] = ()
    strictness: Strictness = Strictness.BEST_EFFORT


@dataclass(frozen=True, slots=True)
class SwitchPlan:
    """The controllers that will be switched, by name: first all of ``deactivate``, then all of ``activate``."""

    activate: tuple[str, ...]
    deactivate: tuple[str, ...]

    def summary(self) -> str:
        """The result of the switch, in upstream's words."""
        if not self.activate and not self.deactivate:
            return NOTHING
        parts = (("Deactivated", self.deactivate), ("Activated", self.activate))
        return "\n".join([DONE, *(f"{what} controllers: [ {' '.join(names)} ]" for what, names in parts if names)])


Loads = Mapping[str, Loaded]


class Interfaces(Protocol):
    """The hardware's interfaces, and which of them controllers can use now."""

    @property
    def command_interfaces(self) -> tuple[str, ...]:
        """In the order of the hardware's commands (``joint1/position``)."""
        ...

    def ready(self, interface: str) -> bool:
        """Whether a controller can use this command interface now."""
        ...

    def measured(self, interface: str) -> bool:
        """Whether a controller can use this state interface now."""
        ...


def plan_switch(loaded: Loads, request: SwitchRequest, hardware: Interfaces) -> SwitchPlan:
    """The part of ``request`` that is to be done. Raises SwitchError where nothing may be switched."""
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
    """The claimed command interfaces and the active controllers that claim them, but for those named."""
    gone = set(without)
    return {
        claim: entry.name
        for entry in loaded.values()
        if entry.active and entry.name not in gone
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
    """The active controllers that claim what ``start`` wants."""
    owners = taken(loaded, without=(*start, *stop))
    return tuple(dict.fromkeys(owners[claim] for name in start for claim in loaded[name].commands if claim in owners))


def _check_interfaces(loaded: Loads, start: tuple[str, ...], stop: tuple[str, ...], hardware: Interfaces) -> None:
    owners = taken(loaded, without=stop)
    for name in start:
        unable = f"Unable to activate controller '{name}' since the"
        commands = loaded[name].commands
        # A controller without commands may begin at once: the other components' joints are worth seeing too.
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
