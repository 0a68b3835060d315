"""Set up new servos, which all have the same factory ID, as the servos of an arm."""
