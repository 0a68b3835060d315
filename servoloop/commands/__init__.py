"""Commands of ``servoloop``. Each command parses its arguments, calls the other packages and prints the results."""
