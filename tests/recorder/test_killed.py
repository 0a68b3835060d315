"""A recording program killed by SIGKILL leaves a file with all messages handed to the operating system."""

import subprocess
import sys
from contextlib import suppress
from pathlib import Path

import pytest
from mcap.reader import NonSeekingReader
from mcap_ros2.decoder import DecoderFactory

from tests.recorder.reading import stamp_s

ROOT = Path(__file__).parents[2]


@pytest.fixture(scope="module")
def killed(tmp_path_factory: pytest.TempPathFactory) -> tuple[Path, int]:
    """Return the file and the minimum number of cycles in it."""
    path = tmp_path_factory.mktemp("killed") / "run.mcap"
    command = [sys.executable, "-m", "tests.recorder.killed", str(path)]
    with subprocess.Popen(command, stdout=subprocess.PIPE, text=True, cwd=ROOT) as process:
        assert process.stdout is not None
        lines = (line for line in process.stdout)
        told = next(int(line) for line in lines if int(line) >= 100)
        process.kill()
        assert process.wait() == -9
    return path, told


@pytest.mark.slow
def test_recording_of_killed_program_is_readable_to_the_end(killed: tuple[Path, int]) -> None:
    path, told = killed
    stamps = []
    with path.open("rb") as stream:
        reader = NonSeekingReader(stream, decoder_factories=[DecoderFactory()])
        with suppress(Exception):  # the library may raise any error for an incomplete end
            for decoded in reader.iter_decoded_messages("/joint_states", log_time_order=False):
                stamps.append(stamp_s(decoded.decoded_message))
    assert len(stamps) >= told and stamps == sorted(stamps)
