"""The gripper action controller: one joint, closed until it arrives or can go no further."""
