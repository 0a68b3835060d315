"""Moving a running arm from a terminal: jogging, and poses with names."""
