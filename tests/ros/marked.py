"""A pytest plug-in: writes which collected tests carry which ``row`` marks, as JSON, to the file ``MARKED`` names."""

import json
import os
from pathlib import Path

import pytest


def pytest_collection_finish(session: pytest.Session) -> None:
    tests: dict[str, list[str]] = {}
    for item in session.items:
        for mark in item.iter_markers("row"):
            for row in mark.args:
                tests.setdefault(row, []).append(item.nodeid)
    Path(os.environ["MARKED"]).write_text(json.dumps(tests))
