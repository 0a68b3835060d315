"""Text from outside (names in files, messages and goals) made fit for logs and terminals."""

import logging
from typing import Final

LONGEST_LINE: Final = 500
"""Characters of a line that are printed; the rest is cut off and counted."""
MOST_LINES: Final = 200


def printable(text: str) -> str:
    """Return the text with control characters escaped and with its lines and their number cut.

    Line breaks stay, for messages of several lines; tabs stay too.
    """
    lines = text.split("\n")
    kept = [printable_line(line) for line in lines[:MOST_LINES]]
    if len(lines) > MOST_LINES:
        kept.append(f"… ({len(lines) - MOST_LINES} more lines)")
    return "\n".join(kept)


def printable_line(line: str) -> str:
    """Return the text on one line: control characters and line breaks are escaped, and what is too long is cut."""
    cut = line[:LONGEST_LINE]
    escaped = "".join(letter if letter.isprintable() or letter == "\t" else _escaped(letter) for letter in cut)
    return escaped if len(line) <= LONGEST_LINE else f"{escaped}… ({len(line)} characters)"


def _escaped(letter: str) -> str:
    return letter.encode("unicode_escape", errors="replace").decode("ascii")


class PrintableFormatter(logging.Formatter):
    """A formatter of log lines. Further lines of one message are indented: none of them passes for another message."""

    def formatMessage(self, record: logging.LogRecord) -> str:
        """Return the line of a record, printable."""
        record.message = printable(record.message).replace("\n", "\n    ")
        return super().formatMessage(record)


def counted(number: int, noun: str) -> str:
    """Return a number with its noun, in the plural unless the number is 1: "1 cycle", "2 cycles"."""
    return f"{number} {noun}" if number == 1 else f"{number} {noun}s"
