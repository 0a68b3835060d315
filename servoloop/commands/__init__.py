"""Commands of ``servoloop``, which parse arguments, call the other packages and print results."""
