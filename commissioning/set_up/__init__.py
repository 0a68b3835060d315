"""Set-up: from factory-new servos, all with one ID, to those of an arm."""
