"""Tests of the setup in a folder with non-ASCII letters in its path, and with an unusable Python."""

import importlib
import os
import shutil
import subprocess
import sys
from collections.abc import Iterator
from pathlib import Path
from types import ModuleType

import pytest

ROOT = Path(__file__).parents[2]
TOOLS = ROOT / "tools"


@pytest.fixture
def plain_path(monkeypatch: pytest.MonkeyPatch) -> Iterator[ModuleType]:
    """Import the module, and remove the modules that it imports afterward, because other tests import them again."""
    before = set(sys.modules)
    monkeypatch.syspath_prepend(str(TOOLS))
    yield importlib.import_module("plain_path")
    for name in set(sys.modules) - before:
        if getattr(sys.modules[name], "__file__", "") and Path(str(sys.modules[name].__file__)).parent == TOOLS:
            del sys.modules[name]


def test_an_ascii_path_is_unchanged(plain_path: ModuleType, tmp_path: Path) -> None:
    with plain_path.plain_root(tmp_path) as root:
        assert root == tmp_path


def test_a_non_ascii_path_gets_a_temporary_link(plain_path: ModuleType, tmp_path: Path) -> None:
    checkout = tmp_path / "größe"
    checkout.mkdir()
    with plain_path.plain_root(checkout) as root:
        assert str(root).isascii() and root.resolve() == checkout.resolve()
    assert not root.is_symlink() and checkout.is_dir()


def test_the_error_names_the_remedy_if_no_folder_has_an_ascii_path(
    plain_path: ModuleType, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    folder = tmp_path / "größe"
    folder.mkdir()
    monkeypatch.setattr("tempfile.tempdir", str(folder))
    remedy = "set TMPDIR to a folder such as /tmp"
    with pytest.raises(plain_path.ToolError, match=remedy), plain_path.plain_root(folder):
        pass


@pytest.mark.slow
def test_cmake_configures_a_message_package_below_a_non_ascii_path(plain_path: ModuleType, tmp_path: Path) -> None:
    pytest.importorskip("rclpy")
    cmake = shutil.which("cmake", path=f"{sys.prefix}/bin")
    if cmake is None:
        pytest.skip("needs the cmake of set-up")
    checkout = tmp_path / "größe"
    shutil.copytree(ROOT / "interfaces" / "tf2_msgs", checkout / "tf2_msgs")
    variables = {"AMENT_PREFIX_PATH": sys.prefix, "CMAKE_PREFIX_PATH": sys.prefix}
    environment = {**os.environ, **variables, "PATH": f"{sys.prefix}/bin:{os.environ['PATH']}"}
    hooks = f"-DCMAKE_PROJECT_INCLUDE={TOOLS / 'cmake' / 'hooks.cmake'}"
    options = (hooks, f"-DPython3_EXECUTABLE={sys.executable}", "-DBUILD_TESTING=OFF")
    with plain_path.plain_root(checkout) as root:
        command = [cmake, "-G", "Ninja", "-S", root / "tf2_msgs", "-B", root / "build", *options]
        done = subprocess.run(command, env=environment, capture_output=True, text=True, timeout=110.0, check=False)
    assert done.returncode == 0, done.stdout + done.stderr


def test_a_python_that_replaces_an_unusable_python_is_named(tmp_path: Path) -> None:
    """The unusable Python is like pyenv's python3 with PYENV_VERSION=3.10.13."""
    checkout = tmp_path / "checkout"
    (checkout / "tools").mkdir(parents=True)
    shutil.copy(TOOLS / "setup.sh", checkout / "tools")
    (checkout / "tools" / "set_up.py").write_text("print('set-up runs')\n")
    (checkout / "tools" / "usable_python.py").write_text("")
    programs = tmp_path / "bin"
    programs.mkdir()
    for name, text in {
        "python3": 'case "$1" in tools/usable_python.py) echo "is version 3.10"; exit 1;; esac',
        "python3.13": f'exec {sys.executable} "$@"',
    }.items():
        (programs / name).write_text(f"#!/bin/sh\n{text}\n")
        (programs / name).chmod(0o755)
    environment = {**os.environ, "PATH": f"{programs}:/usr/bin:/bin", "PYENV_VERSION": "3.10.13"}
    environment.pop("PYTHON", None)
    command = ["sh", str(checkout / "tools" / "setup.sh")]
    done = subprocess.run(command, env=environment, capture_output=True, text=True, timeout=60.0, check=False)
    assert done.returncode == 0, done.stderr
    assert f"{programs / 'python3.13'} is used, because other versions cannot be used:" in done.stdout
    assert "python3: is version 3.10" in done.stdout and "set-up runs" in done.stdout
