"""Life cycle of hardware components and controllers, as in ros2_control."""

from enum import Enum

from hal.hal_errors import LifecycleError


class LifecycleState(Enum):
    """Life cycle states. The values are the state IDs of lifecycle_msgs."""

    UNCONFIGURED = 1
    INACTIVE = 2
    ACTIVE = 3
    FINALIZED = 4


def require(state: LifecycleState, wanted: LifecycleState, action: str) -> None:
    """Raise LifecycleError unless the component is in the required state. ``action`` is a verb used in the message."""
    if state is not wanted:
        raise LifecycleError(f"cannot {action} while {state.name.lower()}: the component must be {wanted.name.lower()}")


def require_configured(state: LifecycleState, action: str) -> None:
    """Raise LifecycleError unless the component is inactive or active. ``action`` is a verb for the message."""
    if state not in (LifecycleState.INACTIVE, LifecycleState.ACTIVE):
        raise LifecycleError(f"cannot {action} while {state.name.lower()}: the component must be inactive or active")
