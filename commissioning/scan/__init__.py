"""Find all servos on a port, at every baud rate and of every make, and report their problems."""
