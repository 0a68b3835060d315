"""MoveIt's interfaces over planning/: the node ``move_group`` with its actions, services and topics."""
