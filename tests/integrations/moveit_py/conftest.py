"""Make the Python package ``moveit`` importable."""

import sys

from tests.pages import ROOT

sys.path.insert(0, str(ROOT / "integrations" / "moveit_py"))
