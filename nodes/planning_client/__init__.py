"""Clients of a node move_group: of ``servoloop plan-server``, or of a real MoveIt."""
