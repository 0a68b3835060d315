"""Sanitize text from files, ROS messages and goals for logs and terminals."""

import logging
from typing import Final

LONGEST_LINE: Final = 500
"""Maximum number of characters to print per line. Longer lines are truncated, and their length is printed."""
MOST_LINES: Final = 200
"""Maximum number of lines to print per text."""


def printable(text: str) -> str:
    """Return the text with control characters escaped and its length limited. Line breaks and tabs are kept."""
    lines = text.split("\n")
    kept = [printable_line(line) for line in lines[:MOST_LINES]]
    if len(lines) > MOST_LINES:
        kept.append(f"… ({len(lines) - MOST_LINES} more lines)")
    return "\n".join(kept)


def printable_line(line: str) -> str:
    """Return the text as one line of limited length. Control characters and line breaks are escaped."""
    cut = line[:LONGEST_LINE]
    escaped = "".join(letter if letter.isprintable() or letter == "\t" else _escaped(letter) for letter in cut)
    return escaped if len(line) <= LONGEST_LINE else f"{escaped}… ({len(line)} characters)"


def _escaped(letter: str) -> str:
    return letter.encode("unicode_escape", errors="replace").decode("ascii")


class PrintableFormatter(logging.Formatter):
    """Log formatter that indents continuation lines, so that they cannot be mistaken for new messages."""

    def formatMessage(self, record: logging.LogRecord) -> str:
        record.message = printable(record.message).replace("\n", "\n    ")
        return super().formatMessage(record)


def counted(number: int, noun: str) -> str:
    """Return a number followed by its noun in the singular or plural, such as "1 cycle" or "2 cycles"."""
    return f"{number} {noun}" if number == 1 else f"{number} {noun}s"
