"""Bugs that show only in rare states of the hardware."""
