"""Bugs in controllers, goals and their results."""
