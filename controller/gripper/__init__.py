"""Move the joint of a gripper until it reaches its goal or stalls on an object."""
