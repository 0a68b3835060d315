"""Try robots of other projects on mock hardware: ``python tools/try_robots.py FOLDER [--markdown]``.

Each subfolder of FOLDER has a ``robot.urdf`` (or ``robot.urdf.xacro``) and a ``controllers.yaml``. The tool starts the
stack with these files, as ``servoloop up --hardware mock --no-ros`` does. The table lists for each robot whether its
stack started, or the message with which the stack refused the files. A traceback is a defect, after which the tool
exits with status 1.
"""

import argparse
import os
import signal
import subprocess
import sys
import tempfile
import time
from dataclasses import dataclass
from pathlib import Path

ROOT = Path(__file__).resolve().parent.parent
START_S = 40.0
"""Maximum time for a stack to start, in seconds."""
END_S = 20.0
"""Maximum time for a shutdown, in seconds."""
NAMES = ("robot.urdf", "robot.urdf.xacro")


@dataclass(frozen=True)
class Trial:
    """Result of one robot."""

    name: str
    up: bool
    output: str

    @property
    def crashed(self) -> bool:
        """Whether the output has a traceback."""
        return "Traceback" in self.output

    @property
    def text(self) -> str:
        """Summary of the result in one line."""
        if self.crashed:
            return f"TRACEBACK: {self.output.strip().splitlines()[-1]}"
        if self.up:
            return "starts"
        lines = [line for line in self.output.splitlines() if line.startswith("servoloop: ")] or ["no message"]
        return "; ".join(line.removeprefix("servoloop: ") for line in lines)


def tried(folder: Path) -> Trial:
    """Start the stack with the files of a folder, and stop it."""
    urdf = next((folder / name for name in NAMES if (folder / name).is_file()), folder / NAMES[0])
    with tempfile.TemporaryDirectory() as place:
        ready, log = Path(place) / "ready", Path(place) / "log"
        command = ["up", "--hardware", "mock", "--no-ros", "--ready-file", str(ready), "--urdf", str(urdf)]
        command += ["--controllers", str(folder / "controllers.yaml")]
        environment = {**os.environ, "PYTHONPATH": str(ROOT), "COLUMNS": "1000", "XDG_RUNTIME_DIR": place}
        with log.open("w") as out:
            process = subprocess.Popen(
                [sys.executable, "-m", "servoloop", *command], stdout=out, stderr=out, env=environment, cwd=place
            )
        end_s = time.monotonic() + START_S
        while not ready.exists() and process.poll() is None and time.monotonic() < end_s:
            time.sleep(0.05)
        up = ready.exists()
        if process.poll() is None:
            process.send_signal(signal.SIGINT)
        try:
            process.wait(END_S)
        except subprocess.TimeoutExpired:
            process.kill()
        return Trial(folder.name, up, log.read_text())


def main() -> int:
    """Try all robots, print the table, and return the exit status."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("folder", type=Path, help="folder with a subfolder for each robot")
    parser.add_argument("--markdown", action="store_true", help="print a table for the documentation")
    options = parser.parse_args()
    trials = []
    for folder in sorted(path for path in options.folder.iterdir() if path.is_dir()):
        trials.append(tried(folder))
        text = trials[-1].text.replace(str(folder), "…")
        print(f"| {folder.name} | {text} |" if options.markdown else f"{folder.name}: {text}", flush=True)
    print(f"{sum(one.up for one in trials)} of {len(trials)} started", file=sys.stderr)
    return 1 if any(one.crashed for one in trials) else 0


if __name__ == "__main__":
    sys.exit(main())
