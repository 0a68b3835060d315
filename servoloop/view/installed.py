"""Whether the view can be shown: its library is an extra."""

import importlib.util

from drivers.errors import DriverError


def require_view() -> None:
    """Raise DriverError, which says what to install, where there is no viser."""
    if importlib.util.find_spec("viser") is None:
        raise DriverError("the view needs viser: pip install 'servoloop[view]'")
