"""Forward command controllers: the newest message is the command, for positions, velocities or efforts."""
