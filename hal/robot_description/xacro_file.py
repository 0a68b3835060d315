"""Expand a URDF written in xacro, a macro language for XML."""

import re
from collections.abc import Collection, Mapping, Sequence
from pathlib import Path
from typing import Final
from xml.parsers.expat import ExpatError

from hal.hal_errors import DescriptionError
from hal.text_file import exists

SUFFIX: Final = ".xacro"
"""Suffix of xacro files."""
_DECLARED: Final = re.compile(r"<xacro:arg\s[^>]*?name\s*=\s*[\"']([^\"']+)[\"']")
_QUOTED: Final = re.compile(r"expression '(.+?)'|name: (?:xacro:)?(\S+)|argument (?:'|\")?([\w-]+)|name '(\w+)'")
"""Pattern for the part of a xacro error message that is quoted from the file."""
_EXPRESSION: Final = re.compile(r"when evaluating expression '(.+?)'")
_FIND: Final = ("AMENT_PREFIX_PATH", "ament_index_python", "PackageNotFound")
"""Strings that occur in the error messages about $(find PACKAGE)."""


def expand_xacro(path: Path, arguments: Mapping[str, str]) -> str:
    """Expand a xacro file.

    Args:
        path: The file. The file may include other files.
        arguments: Values of its ``<xacro:arg>``, keyed by name.

    Returns:
        The URDF. Its lines are the same as in the output of the ``xacro`` command.

    Raises:
        DescriptionError: The file cannot be expanded. The message specifies the file and, if xacro reports it, the
            line.
        ModuleNotFoundError: The package xacro is not installed.
    """
    import xacro

    if not (exists(path, DescriptionError) and path.is_file()):
        raise DescriptionError(f"cannot read the URDF {path}: it is not a file")
    xacro.all_includes.clear()
    try:
        document = xacro.process_file(str(path), mappings=dict(arguments))
    except ExpatError as error:
        reason = str(error).partition(":")[0]
        raise DescriptionError(
            f"{_current(xacro.filestack, path)}, line {error.lineno}: {reason}: correct the file"
        ) from error
    except Exception as error:  # The expressions in the file are Python, so they can raise any error.
        raise DescriptionError(_message(error, _current(xacro.filestack, path))) from error
    _check_arguments(path, arguments, [path, *map(Path, xacro.all_includes)])
    return str(document.toprettyxml(indent="  "))


def _current(files: Sequence[str | None] | None, path: Path) -> Path:
    """Return the file that xacro was reading when it failed."""
    return Path(files[-1]) if files and files[-1] else path


def _message(error: Exception, file: Path) -> str:
    whole = " ".join(str(error).split())
    if any(sign in whole for sign in _FIND):
        return (
            f"{file}: $(find PACKAGE) finds a package only in a ROS workspace: source its setup.bash, or write the "
            "path of the included file"
        )
    found = _QUOTED.search(whole)
    part = next((group for group in found.groups() if group), "") if found else ""
    line = _line_of(part, file)
    return f"{file}{f', line {line}' if line else ''}: {_reason(error)}: correct it, or set --xacro-arg NAME:=VALUE"


def _reason(error: Exception) -> str:
    """Return the message of the original error that xacro wraps, with the expression that caused the error."""
    expressions = _EXPRESSION.findall(str(error))
    inner: Exception = error
    while isinstance(wrapped := getattr(inner, "exc", None), Exception):
        inner = wrapped
    text = " ".join(str(inner).split()) or type(inner).__name__
    return f"{text} in ${{{expressions[0]}}}" if expressions else text


def _line_of(part: str, file: Path) -> int:
    """Return the number of the first line that contains a part of an error, or 0."""
    try:
        lines = file.read_text(errors="replace").splitlines()
    except OSError:
        return 0
    return next((number for number, line in enumerate(lines, 1) if part and part in line), 0)


def _check_arguments(path: Path, arguments: Mapping[str, str], files: Collection[Path]) -> None:
    """Check that the files declare all arguments, because xacro ignores undeclared arguments."""
    if not arguments:
        return
    declared = [name for file in files for name in _DECLARED.findall(file.read_text(errors="replace"))]
    if unknown := [name for name in arguments if name not in declared]:
        known = f"it declares {', '.join(dict.fromkeys(declared))}" if declared else "it declares none"
        raise DescriptionError(f"{path} has no xacro argument {', '.join(unknown)} ({known}): correct --xacro-arg")
