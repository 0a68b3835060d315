"""Teleoperation: a follower arm goes where a leader arm is."""
