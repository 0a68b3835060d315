"""Save the EEPROM of all servos on a bus to a readable file (a passport), compare it with servos, and write it back."""
