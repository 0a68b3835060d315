"""Bugs in the hardware components and in the drivers."""
