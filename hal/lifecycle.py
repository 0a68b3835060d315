"""ros2_control's life cycle, of hardware components and controllers."""

from enum import Enum

from hal.errors import LifecycleError


class LifecycleState(Enum):
    """States of a hardware component or a controller; the values are lifecycle_msgs' ids."""

    UNCONFIGURED = 1
    INACTIVE = 2
    ACTIVE = 3
    FINALIZED = 4


def require(state: LifecycleState, wanted: LifecycleState, what: str) -> None:
    """Raise LifecycleError unless the component is in the wanted state."""
    if state is not wanted:
        raise LifecycleError(f"cannot {what} while {state.name.lower()}: it must be {wanted.name.lower()}")


def require_configured(state: LifecycleState, what: str) -> None:
    """Raise LifecycleError unless the component has been configured."""
    if state not in (LifecycleState.INACTIVE, LifecycleState.ACTIVE):
        raise LifecycleError(f"cannot {what} while {state.name.lower()}: it must be inactive or active")
