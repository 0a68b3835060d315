"""The virtual servos: firmware, control table and packets of each series."""
