"""Fixtures with servoloop installed as in a ROS 2 workspace: by CMake, into a separate prefix."""

import os
import shutil
import subprocess
import sys
from collections.abc import Iterator
from pathlib import Path

import pytest

from tests.launch.recorders import modules

ROOT = Path(__file__).parents[2]


def ros_prefixes() -> str:
    """Return the value of AMENT_PREFIX_PATH with which ROS is found."""
    return os.pathsep.join(filter(None, [sys.prefix, os.environ.get("AMENT_PREFIX_PATH")]))


def install(folder: Path, *options: str) -> Path:
    """Configure, build and install the package, and return the prefix."""
    prefix, build = folder / "install", str(folder / "build")
    search = os.pathsep.join([str(Path(sys.prefix) / "bin"), os.environ["PATH"]])
    cmake = shutil.which("cmake", path=search)
    assert cmake, "no cmake"
    # The environment is that of a shell in which ROS was sourced. The wheels install ROS into Python's own prefix.
    environment = os.environ | {
        "PATH": search,
        "CMAKE_PREFIX_PATH": ros_prefixes(),
        "AMENT_PREFIX_PATH": ros_prefixes(),
    }
    definitions = [f"-DCMAKE_INSTALL_PREFIX={prefix}", f"-DPython3_EXECUTABLE={sys.executable}", *options]
    for command in (
        ["-S", str(ROOT), "-B", build, *definitions],
        ["--build", build],
        ["--install", build],
    ):
        # Run in the folder, because CMake writes the install manifest into the current folder if files are symlinks.
        run = subprocess.run([cmake, *command], cwd=folder, env=environment, capture_output=True, text=True, timeout=60)
        assert run.returncode == 0, run.stdout + run.stderr
    return prefix


def pytest_collection_modifyitems(items: list[pytest.Item]) -> None:
    """Mark all tests that need a workspace as slow, because these tests wait until the workspace is built."""
    for item in items:
        if "workspace" in getattr(item, "fixturenames", ()):
            item.add_marker(pytest.mark.slow)


@pytest.fixture(scope="session")
def installed(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Return the prefix, which is built once for all tests."""
    pytest.importorskip("ament_package")
    return install(tmp_path_factory.mktemp("workspace"))


@pytest.fixture
def workspace(installed: Path, monkeypatch: pytest.MonkeyPatch) -> Iterator[Path]:
    """Return the prefix, with the environment set as its setup script would set it."""
    (packages,) = installed.glob("lib/python*/site-packages")
    monkeypatch.setenv("AMENT_PREFIX_PATH", f"{installed}{os.pathsep}{ros_prefixes()}")
    monkeypatch.setenv("PYTHONPATH", str(packages))
    yield installed


@pytest.fixture
def share(workspace: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """Return the share folder of the workspace, and allow launch files to be imported."""
    for name, module in modules().items():
        monkeypatch.setitem(sys.modules, name, module)
    return workspace / "share" / "servoloop"
