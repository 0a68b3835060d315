"""Tests of the installation by CMakeLists.txt into a ROS 2 workspace: packages, programs, shared files, ament index."""

import ast
import json
import os
import subprocess
import sys
import tomllib
import xml.etree.ElementTree as ElementTree
from pathlib import Path

import pytest

from tests.launch.conftest import ROOT, install, ros_prefixes

pytestmark = pytest.mark.ros

PROBE = """
import json, controller, drivers, hal, nodes, sim_backend.scene.world
from servoloop.stack import robot_files
from ament_index_python.packages import get_package_share_directory
print(json.dumps({
    "modules": [str(m.__file__) for m in (controller, drivers, hal, nodes, robot_files, sim_backend.scene.world)],
    "robot": str(robot_files.read_files().robot_path),
    "scene": str(sim_backend.scene.world.SCENE.resolve(strict=True)),
    "share": get_package_share_directory("servoloop"),
}))
"""


def probe(folder: Path) -> dict[str, object]:
    run = subprocess.run([sys.executable, "-c", PROBE], cwd=folder, capture_output=True, text=True, timeout=60)
    assert run.returncode == 0, run.stderr
    found: dict[str, object] = json.loads(run.stdout)
    return found


def files(folder: Path) -> set[str]:
    """Return all installed files, without the caches of Python and numba."""
    kept = (p for p in folder.rglob("*") if p.is_file() and "__pycache__" not in p.parts and p.suffix != ".db")
    return {str(p.relative_to(folder)) for p in kept}


def test_the_packages_are_imported_from_the_workspace_and_find_their_files(workspace: Path, tmp_path: Path) -> None:
    found = probe(tmp_path)
    modules, share = found["modules"], workspace / "share" / "servoloop"
    assert isinstance(modules, list)
    assert [module for module in modules if not module.startswith(f"{workspace}/lib/python")] == []
    assert Path(str(found["robot"])).resolve() == share / "config" / "robot_arm.yaml"
    assert found["scene"] == str(share / "urdf" / "scene.xml")
    assert found["share"] == str(share)


@pytest.mark.parametrize("folder", ["config", "launch", "urdf"])
def test_shared_files_are_complete(workspace: Path, folder: str) -> None:
    assert files(workspace / "share" / "servoloop" / folder) == files(ROOT / folder)


def test_every_module_is_there(workspace: Path) -> None:
    pyproject = tomllib.loads((ROOT / "pyproject.toml").read_text())
    (packages,) = workspace.glob("lib/python*/site-packages")
    for name in pyproject["tool"]["hatch"]["build"]["targets"]["wheel"]["packages"]:
        assert files(packages / name) == files(ROOT / name), name


def test_the_index_knows_the_package(workspace: Path) -> None:
    assert (workspace / "share" / "ament_index" / "resource_index" / "packages" / "servoloop").is_file()
    manifest = ElementTree.parse(workspace / "share" / "servoloop" / "package.xml").getroot()
    project = tomllib.loads((ROOT / "pyproject.toml").read_text())["project"]
    assert manifest.findtext("name") == project["name"]
    assert manifest.findtext("version") == project["version"]


def test_the_manifest_names_every_ros_package_that_nodes_may_import() -> None:
    depends = {element.text for element in ElementTree.parse(ROOT / "package.xml").getroot().findall("exec_depend")}
    imported: set[str] = set()
    for path in (ROOT / "nodes").glob("*.py"):
        for node in ast.walk(ast.parse(path.read_text())):
            if isinstance(node, ast.ImportFrom):
                imported.add(str(node.module).split(".")[0])
            elif isinstance(node, ast.Import):
                imported |= {alias.name.split(".")[0] for alias in node.names}
    own = {"controller", "drivers", "hal", "nodes", "perception", "pick_place", "planning", "servoloop", "sim_backend"}
    ros = imported - own - set(sys.stdlib_module_names) - {"numpy", "yaml", "pydantic"}
    assert "rclpy" in ros
    assert ros <= depends


def test_programs_run(workspace: Path) -> None:
    program = workspace / "lib" / "servoloop" / "servoloop"
    run = subprocess.run([program, "up", "--help"], capture_output=True, text=True, timeout=60)
    assert run.returncode == 0, run.stderr
    assert "--controllers" in run.stdout


@pytest.mark.slow
def test_symlink_installation_runs_too_and_follows_the_sources(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """After colcon build --symlink-install, changes in the checkout take effect without a new build."""
    pytest.importorskip("ament_package")
    prefix = install(tmp_path, "-DAMENT_CMAKE_SYMLINK_INSTALL=1")
    (packages,) = prefix.glob("lib/python*/site-packages")
    assert (packages / "hal" / "gate.py").resolve() == ROOT / "hal" / "gate.py"
    assert os.access(prefix / "lib" / "servoloop" / "servoloop", os.X_OK)
    monkeypatch.setenv("AMENT_PREFIX_PATH", f"{prefix}{os.pathsep}{ros_prefixes()}")
    monkeypatch.setenv("PYTHONPATH", str(packages))
    assert probe(tmp_path)["robot"] == str(ROOT / "config" / "robot_arm.yaml")
