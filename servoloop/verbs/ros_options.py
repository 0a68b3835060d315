"""What verbs that run nodes share."""

import logging
import os
from typing import Annotated

import typer

from drivers.printable import PrintableFormatter

NetworkOption = Annotated[bool, typer.Option("--network", help="Not only this machine: the whole network.")]


def set_network(network: bool) -> None:
    """Let nodes of this process talk to the whole network, where it is wanted."""
    from nodes.discovery import open_to_network

    if network:
        open_to_network(os.environ)


def log_to_terminal() -> None:
    """Show what the stack says of itself."""
    handler = logging.StreamHandler()
    handler.setFormatter(PrintableFormatter("%(levelname)s %(name)s: %(message)s"))
    logging.basicConfig(level=logging.INFO, handlers=[handler])
