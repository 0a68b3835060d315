"""Simulated programs on the command socket."""
