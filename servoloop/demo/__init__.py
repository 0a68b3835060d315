"""``servoloop demo``: sort cubes with a virtual arm, show the progress and measure the motion."""
