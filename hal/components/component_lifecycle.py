"""The life cycle of all components of a set: at the loop's start and at its end, and where a start fails half-way."""

import logging
from collections.abc import Callable, Collection, Sequence

from drivers.errors import DriverError
from hal.components.component import Component
from hal.components.component_set import ComponentSet
from hal.errors import HalError
from hal.hardware import Hardware, undo_activation
from hal.lifecycle import LifecycleState

LOG = logging.getLogger("servoloop.hal")


def configure_all(components: ComponentSet, leave_out: Collection[str] = (), keep_alive: bool = False) -> None:
    """Configure all but those named. Raises what the first one raises, with those before it given back.

    ``keep_alive``: such a one stays as it is, and the others go on.
    """
    try:
        for component in components.components:
            if component.name not in leave_out:
                _try(component, component.hardware.configure, keep_alive)
    except BaseException:
        clean_up_all(components)
        raise


def activate_all(components: ComponentSet, keep_inactive: Collection[str] = (), keep_alive: bool = False) -> None:
    """Activate all that are inactive, but for those named.

    Raises what the first one raises, with the activation of those before it undone. ``keep_alive``: such a one stays
    as it is, and the others go on.
    """
    done: list[Component] = []
    try:
        for component in components.components:
            if component.hardware.state is LifecycleState.INACTIVE and component.name not in keep_inactive:
                _try(component, component.hardware.activate, keep_alive)
                done.append(component)
    except BaseException:
        for component in (one for one in done if one.hardware.state is LifecycleState.ACTIVE):
            for problem in undo_activation(component.hardware):
                LOG.error("torque may still be on: %s", problem)
        raise


def deactivate_all(components: ComponentSet, relax: bool) -> Sequence[str]:
    """Deactivate all that are active, whatever becomes of the others; returns what went wrong."""
    return _switch_off(components, lambda hardware: hardware.deactivate(relax))


def undo_all(components: ComponentSet) -> Sequence[str]:
    """Undo the activation of all active components, even if one of them fails; returns the errors."""
    return _switch_off(components, undo_activation)


def _switch_off(components: ComponentSet, step: Callable[[Hardware], Sequence[str]]) -> Sequence[str]:
    problems: list[str] = []
    for component in components.components:
        if component.hardware.state is LifecycleState.ACTIVE:
            try:
                problems += step(component.hardware)
            except Exception as error:  # the next component matters more than this one's failure
                whom = f" {component.name}" if len(components.components) > 1 else ""
                problems.append(f"could not switch{whom} off: {error}")
    return problems


def clean_up_all(components: ComponentSet) -> None:
    """Give everything back, of each component; then raises what the first one raised."""
    errors: list[Exception] = []
    for component in components.components:
        try:
            component.hardware.cleanup()
        except Exception as error:  # the others still hold their ports
            errors.append(error)
    if errors:
        raise errors[0]


def _try(component: Component, step: Callable[[], None], keep_alive: bool) -> None:
    try:
        step()
    except (DriverError, HalError) as error:
        if not keep_alive:
            raise
        LOG.error("%s stays %s: %s", component.name, component.state.name.lower(), error)
