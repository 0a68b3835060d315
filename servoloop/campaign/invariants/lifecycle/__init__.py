"""Invariants on the activation of the hardware and on the end of the program."""
