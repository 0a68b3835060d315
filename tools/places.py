"""Folders and files of the setup."""

import sysconfig
from pathlib import Path

ROOT = Path(__file__).resolve().parent.parent
INTERFACES = ROOT / "interfaces"
MOVEIT_PY = ROOT / "integrations" / "moveit_py"
ROS2_CLI = ROOT / "integrations" / "ros2_cli"
LOCK = ROOT / "requirements.lock"
HOOKS = ROOT / "tools" / "cmake" / "hooks.cmake"
LOGS = ROOT / "build" / "setup"
VENV = ROOT / ".venv"
PYTHON = VENV / "bin" / "python"
STAMPS = VENV / "stamps"
SITE_PACKAGES = Path(sysconfig.get_path("purelib", "venv", {"base": str(VENV)}))
