"""Bugs that tests plant in the stack, each with the invariants that may detect it."""

from tests.servoloop.planted_bugs import controllers, hardware, rare_states, stack
from tests.servoloop.planted_bugs.registry import BUGS

__all__ = ["BUGS", "controllers", "hardware", "rare_states", "stack"]
