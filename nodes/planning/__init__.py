"""MoveIt's interfaces to the planner in planning/: the ``move_group`` node with its actions, services and topics."""
