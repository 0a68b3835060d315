"""Clients of a move_group node: that of ``servoloop plan-server`` or of a real MoveIt."""
