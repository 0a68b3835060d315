"""Errors of controllers and of the controller manager.

Exception
├── ControllersFileError   errors in the controllers file
├── PluginError            an installed plugin cannot be loaded
└── ManagerError           the controller manager cannot serve a request
    ├── SwitchError        controllers cannot be switched
    └── ClaimError         the hardware lacks an interface of a controller
"""


class ControllersFileError(Exception):
    """The controllers file has errors. The message lists each error with file and line."""


class PluginError(Exception):
    """An installed plugin cannot be loaded."""


class ManagerError(Exception):
    """The manager rejects a request. The message contains the reason and the remedy."""


class SwitchError(ManagerError):
    """A switch failed."""


class ClaimError(ManagerError):
    """A controller claims an interface that the hardware does not have."""
