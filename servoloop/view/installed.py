"""Whether the view can be shown: its library is an extra."""

import importlib.util

from drivers.errors import DriverError
from servoloop.extras import install_command


def require_view() -> None:
    """Raise DriverError, which says what to install, where there is no viser."""
    if importlib.util.find_spec("viser") is None:
        raise DriverError(f"the view needs viser: {install_command('view')}")
