"""Teleoperation: a follower arm copies the motion of a leader arm."""
