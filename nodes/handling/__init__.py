"""Manual motion of a running arm from another program. The arm moves only while the operator keeps commanding it."""
