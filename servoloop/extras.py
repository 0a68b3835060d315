"""Optional components (extras) of servoloop: their libraries, and the commands that install them."""

import importlib.util
import json
import shlex
import sys
from collections.abc import Mapping
from importlib.metadata import PackageNotFoundError, distribution
from pathlib import Path
from typing import Final

from drivers.driver_errors import DriverError

LIBRARIES: Final[Mapping[str, Mapping[str, str]]] = {
    "sim": {"mujoco": "mujoco", "numba": "numba", "PIL": "pillow"},
    "view": {"viser": "viser", "trimesh": "trimesh", "websockets": "websockets", "mujoco": "mujoco"},
    "monitor": {"textual": "textual"},
    "report": {"matplotlib": "matplotlib", "jinja2": "jinja2"},
    "planning": {"ompl": "ompl", "mujoco": "mujoco", "numba": "numba"},
    "vision": {"cv2": "opencv-python-headless"},
    "onnx": {"onnxruntime": "onnxruntime"},
    "xacro": {"xacro": "xacro"},
    "ray": {"ray": "ray"},
}
"""Modules of each extra, mapped to pip package names. The ros extra is checked by nodes/ros_environment.py."""


class ExtraError(DriverError):
    """A library of an extra is not installed. The message contains the command that installs the extra."""


def require_extras(purpose: str, *extras: str) -> None:
    """Check that all libraries of the given extras are installed.

    Args:
        purpose: Component of servoloop that needs the extras, such as "the view".
        extras: Names of the extras.

    Raises:
        ExtraError: A library is not installed.
    """
    if sentence := missing_extras(purpose, *extras):
        raise ExtraError(sentence)


def missing_extras(purpose: str, *extras: str) -> str:
    """Return a sentence that lists the missing libraries and the command that installs them, or an empty string."""
    absent = {extra: names for extra in extras if (names := _absent(LIBRARIES[extra]))}
    names = list(dict.fromkeys(name for libraries in absent.values() for name in libraries))
    return _sentence(purpose, names, list(absent)) if absent else ""


def _absent(libraries: Mapping[str, str]) -> list[str]:
    return [name for module, name in libraries.items() if not _is_installed(module)]


def _is_installed(module: str) -> bool:
    if module in sys.modules:
        return sys.modules[module] is not None
    return importlib.util.find_spec(module) is not None


def extra_error(error: ModuleNotFoundError) -> ExtraError | None:
    """Return the error to report in place of a failed import, or None if no extra contains the module."""
    module = (error.name or "").partition(".")[0]
    for extra, libraries in LIBRARIES.items():
        if module in libraries:
            return ExtraError(_sentence("this command", [libraries[module]], [extra]))
    return None


def _sentence(purpose: str, names: list[str], extras: list[str]) -> str:
    listed = " and ".join(", ".join(names).rsplit(", ", 1))
    pronoun = "it" if len(names) == 1 else "them"
    return f"{purpose} needs {listed}; install {pronoun} with: {install_command(*extras)}"


def install_command(*extras: str) -> str:
    """Return the command that installs extras in this program's environment.

    servoloop is not available on a package index, so the command contains the folder or URL it was installed from.
    """
    python, requirement = shlex.quote(sys.executable), shlex.quote(f"{_source()}[{','.join(extras)}]")
    if importlib.util.find_spec("pip") is None:  # uv creates environments without pip
        return f"uv pip install --python {python} {requirement}"
    return f"{python} -m pip install {requirement}"


def _source() -> str:
    root = Path(__file__).parents[1]
    if (root / "pyproject.toml").is_file():
        return str(root)
    try:
        installed = json.loads(distribution("servoloop").read_text("direct_url.json") or "{}")
    except (PackageNotFoundError, ValueError):
        installed = {}
    url = str(installed.get("url", ""))
    if version_control := installed.get("vcs_info", {}).get("vcs"):
        url = f"{version_control}+{url}"
    return f"servoloop @ {url}".replace("servoloop @ file://", "") if url else "servoloop"
