"""Errors that a user of the command can correct."""


class Ros2Error(Exception):
    """Error that is printed without a traceback."""
