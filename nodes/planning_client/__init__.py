"""Clients of a move_group node, which belongs to ``servoloop plan-server`` or to MoveIt itself."""
