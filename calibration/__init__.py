"""What scripts that set up and calibrate single servos need above the bus: no cycle of an arm passes here."""
