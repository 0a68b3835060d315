"""Hardware plugins in user packages, which are found through the entry points of the installed packages."""

from importlib.metadata import entry_points

from controller.manager.plugins import why_not_loaded
from controller.manager_errors import PluginError
from drivers.clock import Clock
from hal.hal_errors import HalError
from hal.hardware import Hardware, outputs_of
from hal.robot_description.hardware_info import HardwareInfo

ENTRY_POINTS = "servoloop.hardware"
"""Entry-point group of hardware plugins in user packages.

An entry has the form ``package/Class = module:make``. The call ``make(component, clock)`` returns a
hal.hardware.Hardware for the ``<ros2_control>`` block ``component``.
"""


def plugin_names() -> list[str]:
    """Return the names of the installed plugins."""
    return sorted(entry_points(group=ENTRY_POINTS).names)


def plugin_hardware(plugin: str, component: HardwareInfo, clock: Clock) -> Hardware:
    """Create the hardware with an installed plugin. Raises PluginError."""
    (point,) = entry_points(group=ENTRY_POINTS, name=plugin)
    try:
        hardware: Hardware = point.load()(component, clock)
    except HalError:
        raise  # The message already explains how to correct the error.
    except Exception as error:  # A user's module may raise any exception when it is imported.
        raise PluginError(f"the hardware {plugin} {why_not_loaded(point, error)}") from error
    _check_names(hardware, component)
    if missing := [name for name in component.outputs if name not in outputs_of(hardware)]:
        raise PluginError(
            f"the hardware {plugin} has no output {', '.join(missing)}: remove this <command_interface> from its "
            f"<ros2_control> block '{component.name}'"
        )
    return hardware


def _check_names(hardware: Hardware, component: HardwareInfo) -> None:
    """Raise PluginError if the name, joints or interfaces of a plugin differ from its ``<ros2_control>`` block."""
    pairs: tuple[tuple[str, object, object], ...] = (
        ("name", hardware.name, component.name),
        ("joints", tuple(hardware.joints), component.joints),
        ("command_interfaces", tuple(hardware.command_interfaces), component.commands),
    )
    for attribute, has, needs in pairs:
        if has != needs:
            raise PluginError(
                f"the hardware {component.plugin} has the {attribute} {has}, but its <ros2_control> block "
                f"'{component.name}' has {needs}: copy the values from the component that is passed to the class"
            )
