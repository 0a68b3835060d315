"""Make the plug-in for LeRobot importable. The shared modules of the plug-in do not need LeRobot."""

import sys

from tests.pages import ROOT

PLUGIN = ROOT / "integrations" / "lerobot"
sys.path.insert(0, str(PLUGIN))
