"""Stamps in .venv: hashes of each installed part's sources, so that unchanged parts are not built again."""

import hashlib
import os
import re
import sys
from pathlib import Path

from interface_packages import needed_packages
from places import HOOKS, INTERFACES, LOCK, MOVEIT_PY, ROOT, ROS2_CLI, STAMPS, VENV


def digest(*parts: str | Path) -> str:
    """Return one hash of texts, files, and folders of files."""
    total = hashlib.sha256()
    for part in parts:
        files = [part] if isinstance(part, Path) and part.is_file() else []
        if isinstance(part, Path) and part.is_dir():
            files = sorted(path for path in part.rglob("*") if path.is_file())
        for path in files:
            total.update(f"{path.relative_to(ROOT)}\0".encode() + path.read_bytes() + b"\0")
        if isinstance(part, str):
            total.update(part.encode() + b"\0")
    return total.hexdigest()


def is_stamped(name: str, key: str) -> bool:
    stamp = STAMPS / name
    return stamp.exists() and stamp.read_text() == key


def stamp(name: str, key: str) -> None:
    STAMPS.mkdir(exist_ok=True)
    (STAMPS / name).write_text(key)


def locked_packages() -> dict[str, str]:
    """Return the version of each package in the lock file, keyed by package name."""
    return dict(re.findall(r"^([a-z0-9-]+)==(\S+)", LOCK.read_text(), re.MULTILINE))


def venv_key() -> str:
    # A virtual environment contains absolute paths: its own path and the path of its base Python.
    return digest(str(VENV), sys.version, os.path.realpath(sys.executable))


def project_key() -> str:
    return digest(ROOT / "pyproject.toml")


def moveit_py_key() -> str:
    return digest(MOVEIT_PY / "pyproject.toml")


def ros2_cli_key() -> str:
    return digest(ROS2_CLI / "pyproject.toml")


def simulation_key() -> str:
    """Return one hash of all sources of compiled functions, because these functions call each other."""
    folders = (ROOT / "sim_backend", ROOT / "planning")
    sources = sorted(path for one in folders for path in one.rglob("*.py") if "@compiled" in path.read_text())
    versions = [f"{name} {version}" for name, version in locked_packages().items() if name in ("numba", "llvmlite")]
    return digest(*sources, *versions, venv_key())


def interface_key(package: str) -> str:
    tools = [
        f"{name} {version}" for name, version in locked_packages().items() if re.match("ros-|cmake|empy|numpy", name)
    ]
    sources = [INTERFACES / name for name in (package, *sorted(needed_packages(package)))]
    return digest(*sources, HOOKS, *tools)
