"""Everything but nodes/ can be imported on a machine without ROS."""

import subprocess
import sys
from pathlib import Path

ROOT = Path(__file__).parents[2]

PROGRAM = """
import importlib, pkgutil, sys

class NoRos:
    def find_spec(self, name, path=None, target=None):
        top = name.partition(".")[0]
        if top in ("rclpy", "nodes") or top.endswith(("_msgs", "_interfaces")):
            raise ImportError("no ROS here: " + name)

sys.meta_path.insert(0, NoRos())
for package in ("drivers", "hal", "controller", "sim_backend", "servoloop"):
    for module in pkgutil.walk_packages(importlib.import_module(package).__path__, package + "."):
        if not module.name.endswith("__main__"):
            importlib.import_module(module.name)
            print(module.name)
"""


def test_all_rooms_but_nodes_import_without_ros() -> None:
    done = subprocess.run([sys.executable, "-c", PROGRAM], capture_output=True, text=True, cwd=ROOT, timeout=60)
    assert done.returncode == 0, done.stderr
    assert "servoloop.demo" in done.stdout and "controller.loop" in done.stdout
