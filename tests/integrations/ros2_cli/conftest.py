"""Make the package of the command ``ros2`` importable."""

import sys

from tests.pages import ROOT

sys.path.insert(0, str(ROOT / "integrations" / "ros2_cli"))
