"""The monitor: an arm in a terminal, from a running stack or from a recording."""
