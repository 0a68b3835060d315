"""Run the life cycle transitions of all components of a set when the control loop starts and stops."""

import logging
from collections.abc import Callable, Collection, Sequence

from drivers.driver_errors import DriverError
from hal.components.component import Component
from hal.components.component_set import ComponentSet
from hal.hal_errors import HalError
from hal.hardware import Hardware, undo_activation
from hal.lifecycle import LifecycleState

LOG = logging.getLogger("servoloop.hal")


def configure_all(components: ComponentSet, leave_out: Collection[str] = (), keep_alive: bool = False) -> None:
    """Configure the components of a set.

    Args:
        components: The set.
        leave_out: Names of components not to configure.
        keep_alive: Continue with the other components if one cannot be configured. The state of the failed component
            does not change.

    Raises:
        DriverError, HalError: A component could not be configured. All components have been cleaned up.
    """
    try:
        for component in components.components:
            if component.name not in leave_out:
                _try(component, component.hardware.configure, keep_alive)
    except BaseException:
        for component, error in _clean_up(components):
            LOG.error("%s could not be cleaned up: %s", component.name, error)
        raise


def activate_all(components: ComponentSet, keep_inactive: Collection[str] = (), keep_alive: bool = False) -> None:
    """Activate the inactive components of a set.

    Args:
        components: The set.
        keep_inactive: Names of components not to activate.
        keep_alive: Continue with the other components if one cannot be activated. The state of that component does not
            change.

    Raises:
        DriverError, HalError: A component could not be activated. The activation of the other components has been
        undone.
    """
    done: list[Component] = []
    try:
        for component in components.components:
            if component.hardware.state is LifecycleState.INACTIVE and component.name not in keep_inactive:
                _try(component, component.hardware.activate, keep_alive)
                done.append(component)
    except BaseException:
        for problem in _switch_off(components, undo_activation, done):
            LOG.error("torque may still be on: %s", problem)
        raise


def deactivate_all(components: ComponentSet, relax: bool) -> Sequence[str]:
    """Deactivate all active components, even if some of them fail. Return the errors.

    Args:
        components: The set.
        relax: Whether to disable the torque. If False, the joints hold their positions.
    """
    return _switch_off(components, lambda hardware: hardware.deactivate(relax), components.components)


def undo_all(components: ComponentSet) -> Sequence[str]:
    """Undo the activation of all active components, even if some of them fail. Return the errors."""
    return _switch_off(components, undo_activation, components.components)


def _switch_off(
    components: ComponentSet, step: Callable[[Hardware], Sequence[str]], chosen: Sequence[Component]
) -> Sequence[str]:
    """Apply ``step`` to the active components in ``chosen``, even if some of them fail. Return the errors."""
    problems: list[str] = []
    for component in chosen:
        if component.hardware.state is LifecycleState.ACTIVE:
            try:
                problems += step(component.hardware)
            except Exception as error:  # the other components must still be switched off
                name = f" {component.name}" if len(components.components) > 1 else ""
                problems.append(f"could not switch{name} off: {error}")
    return problems


def clean_up_all(components: ComponentSet) -> None:
    """Clean up all components, even if some of them fail, and finally raise the first error."""
    errors = _clean_up(components)
    if errors:
        raise errors[0][1]


def _clean_up(components: ComponentSet) -> list[tuple[Component, Exception]]:
    """Clean up all components, even if some of them fail. Return the errors with their components."""
    errors: list[tuple[Component, Exception]] = []
    for component in components.components:
        try:
            component.hardware.cleanup()
        except Exception as error:  # the other components still have their ports open
            errors.append((component, error))
    return errors


def _try(component: Component, step: Callable[[], None], keep_alive: bool) -> None:
    try:
        step()
    except (DriverError, HalError) as error:
        if not keep_alive:
            raise
        LOG.error("%s stays %s: %s", component.name, component.state.name.lower(), error)
