"""MoveIt's Python interface over the services of a move_group node, for machines without MoveIt."""
