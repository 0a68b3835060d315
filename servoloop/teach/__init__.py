"""``servoloop teach`` and ``servoloop replay``: an arm moved by hand, and what was shown or recorded played back."""
