"""Find all servos of every make on a port, at every baud rate, and report their problems."""
