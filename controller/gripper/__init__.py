"""Move a gripper joint until it reaches its goal or stalls on an object."""
