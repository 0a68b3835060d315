"""Make the plugin for LeRobot importable. The shared modules of the plugin do not need LeRobot."""

import sys

from tests.pages import ROOT

PLUGIN = ROOT / "integrations" / "lerobot"
sys.path.insert(0, str(PLUGIN))
