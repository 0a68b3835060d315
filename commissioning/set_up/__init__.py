"""Set up new servos, which all have the same ID, as the servos of an arm."""
