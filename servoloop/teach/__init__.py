"""Implementation of ``servoloop teach`` and ``servoloop replay``: record motions by hand and play them back."""
