"""Whether the view can be shown: its libraries are an extra."""

import importlib.util

from drivers.errors import DriverError
from servoloop.extras import install_command


def require_view(what: str = "the view", library: str = "viser") -> None:
    """Raise DriverError, which names the command that installs it, where the library is missing."""
    if importlib.util.find_spec(library) is None:
        raise DriverError(f"{what} needs {library}: {install_command('view')}")
