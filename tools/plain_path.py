"""Provide an ASCII path of the checkout, because CMake splits lists of files at other characters."""

import tempfile
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

from commands import ToolError
from places import ROOT


@contextmanager
def plain_root(root: Path = ROOT) -> Iterator[Path]:
    """Return the checkout, or a link to it in the temporary folder if its path has non-ASCII letters."""
    if str(root).isascii():
        yield root
        return
    with tempfile.TemporaryDirectory(prefix="servoloop-") as folder:
        if not folder.isascii():
            raise ToolError(
                f"the path of this checkout, {root}, contains characters that the build of the message packages "
                f"cannot handle, and so does the temporary folder, {tempfile.gettempdir()}: set TMPDIR to a folder "
                f"such as /tmp."
            )
        link = Path(folder) / "root"
        link.symlink_to(root, target_is_directory=True)
        yield link
