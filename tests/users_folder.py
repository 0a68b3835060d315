"""An empty user folder with its own environment, in which the commands of a tutorial run as they are printed."""

import os
import shlex
import subprocess
import sys
import sysconfig
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

from tests.pages import ROOT

SCRIPT = "#!{python}\nfrom servoloop.cli import main\nmain()\n"
"""Script that pip creates for the entry point. Unlike ``python -m``, this script does not add the current folder to
Python's module search path."""


class UsersFolder:
    """An empty folder, and an environment in which our packages are installed. Packages that are installed in this
    environment are not visible outside of it."""

    def __init__(self, place: Path) -> None:
        self.folder, environment = place / "project", place / "venv"
        self.folder.mkdir()
        subprocess.run([sys.executable, "-m", "venv", environment], check=True)
        self._bin = environment / "bin"
        site = sysconfig.get_path("purelib", "venv", {"base": str(environment)})
        ours = f"{ROOT}\nimport site; site.addsitedir({sysconfig.get_path('purelib')!r})\n"
        Path(site, "ours.pth").write_text(ours)
        script = self._bin / "servoloop"
        script.write_text(SCRIPT.format(python=self._bin / "python"))
        script.chmod(0o755)

    def write(self, **texts: str) -> None:
        """Write files. In keyword names, ``_`` represents the dot in a file name, as in ``pyproject_toml``."""
        for name, text in texts.items():
            stem, _, ending = name.rpartition("_")
            (self.folder / f"{stem}.{ending}").write_text(text)

    def run(self, command: str) -> str:
        """Run a command to its end and return its output. The call fails if the exit status is not 0."""
        with self.start(command) as process:
            printed, _ = process.communicate(timeout=100.0)
        assert process.returncode == 0, printed
        return printed

    @contextmanager
    def start(self, command: str) -> Iterator[subprocess.Popen[str]]:
        """Start a command whose stdout and stderr go to one pipe, and end the command at the end of the block."""
        environment = os.environ | {"PATH": f"{self._bin}:{os.environ['PATH']}", "VIRTUAL_ENV": str(self._bin.parent)}
        environment.pop("PYTHONPATH", None)
        process = subprocess.Popen(
            shlex.split(command),
            executable=self._bin / shlex.split(command)[0],
            cwd=self.folder,
            env=environment | {"PYTHONUNBUFFERED": "1"},
            stdout=subprocess.PIPE,
            stderr=subprocess.STDOUT,
            text=True,
        )
        with process:
            try:
                yield process
            finally:
                if process.poll() is None:
                    process.terminate()
