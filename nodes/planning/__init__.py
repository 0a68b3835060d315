"""MoveIt's interfaces for the planner in planning/: the node ``move_group`` with its actions, services and topics."""
