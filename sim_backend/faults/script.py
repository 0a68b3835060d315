"""A YAML file with a list of faults. Each fault is a mapping with its ``kind``, its time ``at_s`` and its
parameters."""

from collections.abc import Iterable
from pathlib import Path

import yaml
from pydantic import RootModel

from hal.yaml_file import load
from sim_backend.faults.event import Event
from sim_backend.faults.events import FaultEvent
from sim_backend.faults.fault_error import FaultError


class _Script(RootModel[list[FaultEvent]]):
    """Contents of the fault file."""


def read_script(path: Path) -> tuple[FaultEvent, ...]:
    """Read the faults from the file at ``path``. Raises FaultError with a list of all errors and their lines."""
    return tuple(load(path, _Script, FaultError).root)


def script_text(events: Iterable[Event]) -> str:
    """Return the YAML text that ``read_script`` reads. Parameters with default values are omitted."""
    return yaml.safe_dump([plain(event) for event in events], sort_keys=False)


def plain(event: Event) -> dict[str, object]:
    """Return the event as plain data for YAML and JSON. Parameters with default values are omitted."""
    return {"kind": event.kind, **event.model_dump(exclude_defaults=True)}
