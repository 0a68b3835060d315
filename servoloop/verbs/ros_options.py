"""What verbs that run nodes share."""

import logging
import os
import sys
from contextlib import suppress
from typing import Annotated

import typer

from drivers.printable import PrintableFormatter

NetworkOption = Annotated[bool, typer.Option("--network", help="Not only this machine: the whole network.")]


def set_network(network: bool) -> None:
    """Let nodes of this process talk to the whole network, where it is wanted."""
    from nodes.discovery import open_to_network

    if network:
        open_to_network(os.environ)


class TerminalHandler(logging.Handler):
    """Prints log records on the stderr of the moment.

    A live table replaces stderr so that lines appear above it; written past it, they would leave pieces of the table.
    """

    def emit(self, record: logging.LogRecord) -> None:
        """Print one record."""
        with suppress(OSError, ValueError):  # of a terminal or a pipe that is gone, or a full disk
            print(self.format(record), file=sys.stderr, flush=True)


def log_to_terminal() -> None:
    """Print the log of the stack on the terminal."""
    handler = TerminalHandler()
    handler.setFormatter(PrintableFormatter("%(levelname)s %(name)s: %(message)s"))
    logging.basicConfig(level=logging.INFO, handlers=[handler])
