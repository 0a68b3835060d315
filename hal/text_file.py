"""Read text files from users, detecting the encoding and limiting the size."""

import codecs
import errno
import json
import re
from pathlib import Path
from typing import Final

from hal.file_size import LARGEST_BYTES, too_large

_DECLARED: Final = re.compile(rb"\A\s*<\?xml[^>]*?\sencoding\s*=\s*[\"']([A-Za-z][A-Za-z0-9._-]*)[\"']")
_DECLARATION: Final = re.compile(r"\A(\s*<\?xml[^>]*?\sencoding\s*=\s*[\"'])(?!(?i:utf-8)[\"'])[^\"']*")
_SAVE_AS_UTF_8: Final = "save the file as UTF-8"
_DECLARE: Final = ', or declare its encoding in line 1: <?xml version="1.0" encoding="…"?>'


def exists(path: Path, error: type[Exception]) -> bool:
    """Return whether a path exists. A path that is not valid or too long does not exist.

    Args:
        path: The path.
        error: Class of the error.

    Raises:
        error: The path cannot be checked, for example because its folder is not accessible to the user.
    """
    try:
        path.stat()
    except (FileNotFoundError, NotADirectoryError, ValueError):
        return False
    except OSError as reason:
        if reason.errno == errno.ENAMETOOLONG:
            return False
        raise error(f"cannot access {path}: {reason.strerror}") from reason
    return True


def read_text(path: Path, error: type[Exception]) -> str:
    """Read a text file encoded in UTF-8, or in UTF-16 or UTF-32 if its first bytes indicate this.

    Args:
        path: The file.
        error: Class of the error.

    Raises:
        error: The file cannot be read, is too large or is not text. The message contains the file, the line and a
            remedy.
    """
    data = _read(path, error)
    return _decoded(data, _encoding(data), path, error)


def read_xml(path: Path, error: type[Exception], kind: str = "") -> str:
    """Read an XML file in the encoding that the file declares. The returned text declares UTF-8.

    Args:
        path: The file.
        error: Class of the error.
        kind: Type of file, which precedes the path in a message.

    Raises:
        error: The file cannot be read (see ``read_text``), or the declared encoding is unknown.
    """
    data = _read(path, error, f"{kind} ".lstrip())
    declared, shown = _DECLARED.match(data), _encoding(data)
    if declared is not None and shown == "utf-8":
        text = _declared(data, declared[1].decode(), path, error)
    else:
        text = _decoded(data, shown, path, error, _DECLARE)
    return _DECLARATION.sub(r"\g<1>UTF-8", text)


def _read(path: Path, error: type[Exception], kind: str = "") -> bytes:
    try:
        with path.open("rb") as file:
            data = file.read(LARGEST_BYTES + 1)
    except OSError as reason:
        raise error(f"cannot read {kind}{path}: {reason.strerror}") from reason
    except ValueError as reason:
        raise error(f"cannot read {str(path)!r}: {reason}") from reason
    if len(data) > LARGEST_BYTES:
        raise error(too_large(path))
    return data


def _encoding(data: bytes) -> str:
    """Detect the encoding from a byte order mark or from zeros among the first bytes; the default is UTF-8."""
    return json.detect_encoding(data[:4])


def _declared(data: bytes, encoding: str, path: Path, error: type[Exception]) -> str:
    try:
        name = codecs.lookup(encoding).name
    except LookupError as reason:
        raise error(f"{path}, line 1: the encoding {encoding} is unknown: {_SAVE_AS_UTF_8}") from reason
    if name.startswith(("utf-16", "utf-32")):  # the first bytes would have indicated these encodings
        raise error(f"{path}, line 1: the file declares {encoding} but has a different encoding: {_SAVE_AS_UTF_8}")
    return _decoded(data, "utf-8-sig" if name == "utf-8" else name, path, error)


def _decoded(data: bytes, encoding: str, path: Path, error: type[Exception], remedy: str = "") -> str:
    try:
        text = data.decode(encoding)
    except UnicodeDecodeError as reason:
        line = data.count(b"\n", 0, reason.start) + 1
        raise error(
            f"{path} is not text in {encoding.upper()} (line {line}, byte 0x{data[reason.start]:02x}): "
            f"{_SAVE_AS_UTF_8}{remedy}"
        ) from reason
    except (LookupError, UnicodeError) as reason:  # some Python codecs, such as rot13, do not encode text
        raise error(f"{path}, line 1: {encoding} is not a text encoding: {_SAVE_AS_UTF_8}") from reason
    return text.replace("\r\n", "\n").replace("\r", "\n").removeprefix("\ufeff")
