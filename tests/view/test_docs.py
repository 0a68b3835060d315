"""Commands of docs/view.md. test_page_in_chromium.py and test_emulate_view.py run the other commands of the page."""

import shlex
import urllib.error
import urllib.request
from pathlib import Path

import pytest

from servoloop.dashboard.scene import COLD_C, HOT_C
from servoloop.recording.sources import SPEEDS
from tests.pages import DOCS, commands
from tests.recorder.rig import Rig
from tests.view.view_process import viewing

TEXT = " ".join((DOCS / "view.md").read_text().split())
_, PLAYED, _, OTHERS, _ = commands("view.md")


@pytest.fixture
def recording(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """Write ``job.mcap`` into the working folder."""
    monkeypatch.chdir(tmp_path)
    rig = Rig()
    rig.run(0.5)
    return rig.record(tmp_path / "job.mcap")


@pytest.mark.slow
@pytest.mark.runs(PLAYED)
def test_a_recording_is_shown_at_a_local_address(recording: Path) -> None:
    with viewing(*shlex.split(PLAYED)[2:]) as address, urllib.request.urlopen(address, timeout=20.0) as page:
        assert address.startswith("http://127.0.0.1:") and page.status == 200


@pytest.mark.slow
@pytest.mark.runs(OTHERS)
def test_other_machines_need_the_address_with_the_token(recording: Path) -> None:
    option, host = shlex.split(OTHERS)[2:]
    assert option == "--host" and host.startswith("192.168.")
    with viewing(option, "127.0.0.2", recording.name) as address:
        assert "/?token=" in address
        with pytest.raises(urllib.error.HTTPError, match="403"):
            urllib.request.urlopen(address.partition("?")[0], timeout=20.0)


def test_the_figures_on_the_page_match_the_code() -> None:
    assert f"blue at {COLD_C:.0f} °C, red at {HOT_C:.0f} °C" in TEXT
    assert f"{SPEEDS[0]} to {SPEEDS[-1]} times" in TEXT
