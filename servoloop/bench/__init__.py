"""``servoloop bench arm``: the figures of one arm on one machine, along the path by which it is driven."""
