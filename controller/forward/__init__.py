"""Forward the latest message as the command, for positions, velocities or efforts."""
