"""Which controllers a switch starts and stops, decided before anything is touched. Pure."""

from collections.abc import Callable, Iterable, Mapping
from dataclasses import dataclass, field
from enum import IntEnum

from controller.interface import Controller
from controller.order import Order
from hal.lifecycle import LifecycleState

DONE = "Successfully switched controllers!"
NOTHING = "After checking the controllers, no controllers need to be activated or deactivated."


class ManagerError(Exception):
    """The manager refuses: the text says why, and what to do."""


class SwitchError(ManagerError):
    """Nothing was switched."""


class Strictness(IntEnum):
    """How much of a switch must be possible for any of it to happen; values of SwitchController.

    BEST_EFFORT drops what cannot be. AUTO would also switch what is chained, of which we have nothing, and is the
    same. FORCE_AUTO also stops whoever claims what is wanted.
    """

    BEST_EFFORT = 1
    STRICT = 2
    AUTO = 3
    FORCE_AUTO = 4


@dataclass(frozen=True, slots=True)
class Loaded:
    """A controller as the manager has it: what was ordered, and from its configuration on the controller itself."""

    order: Order
    state: LifecycleState = LifecycleState.UNCONFIGURED
    controller: Controller | None = None
    index: list[int] = field(default_factory=list)
    """Where its commands stand among the hardware's."""

    @property
    def name(self) -> str:
        return self.order.name

    @property
    def active(self) -> bool:
        return self.state is LifecycleState.ACTIVE

    @property
    def running(self) -> Controller:
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
class Wish:
    """What a client wants switched, by name."""

    activate: tuple[str, ...] = ()
    deactivate: tuple[str, ...] = ()
    strictness: Strictness = Strictness.BEST_EFFORT


@dataclass(frozen=True, slots=True)
class Plan:
    """What will be switched, by name: first all of ``deactivate``, then all of ``activate``."""

    activate: tuple[str, ...]
    deactivate: tuple[str, ...]

    def told(self) -> str:
        """What came of it, in upstream's words."""
        if not self.activate and not self.deactivate:
            return NOTHING
        parts = (("Deactivated", self.deactivate), ("Activated", self.activate))
        return "\n".join([DONE, *(f"{what} controllers: [ {' '.join(names)} ]" for what, names in parts if names)])


Loads = Mapping[str, Loaded]
Ready = Callable[[str], bool]
"""Whether the hardware offers this interface now."""


def plan_switch(loaded: Loads, wish: Wish, ready: Ready, measured: Ready) -> Plan:
    """What of ``wish`` is to be done. Raises SwitchError where nothing may be switched."""
    activate, deactivate = dict.fromkeys(wish.activate), dict.fromkeys(wish.deactivate)
    bad = {name: why for name in deactivate if (why := _why_not_deactivate(loaded, name))}
    bad |= {name: why for name in activate if (why := _why_not_activate(loaded, name, set(deactivate) - set(bad)))}
    nobody = not any(name in loaded for name in (*activate, *deactivate))
    if bad and (nobody or wish.strictness is Strictness.STRICT):
        raise SwitchError("\n".join(bad.values()))
    start = tuple(name for name in activate if name not in bad)
    stop = tuple(name for name in deactivate if name not in bad)
    if wish.strictness is Strictness.FORCE_AUTO:
        stop += _rivals(loaded, start, stop)
    _check_interfaces(loaded, start, stop, ready, measured)
    return Plan(start, stop)


def taken(loaded: Loads, without: Iterable[str] = ()) -> dict[str, str]:
    """Who claims what: the command interfaces of the active controllers, but for those named."""
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


def _check_interfaces(
    loaded: Loads, start: tuple[str, ...], stop: tuple[str, ...], ready: Ready, measured: Ready
) -> None:
    owners = taken(loaded, without=stop)
    for name in start:
        unable = f"Unable to activate controller '{name}' since the"
        commands = loaded[name].commands
        # Who only looks on may look on at once: the other components' joints are worth seeing too.
        needs = (("command", commands, ready), ("state", loaded[name].states if commands else (), measured))
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
