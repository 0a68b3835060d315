"""``servoloop teleop``: a leader arm that is moved by hand, and a follower arm."""
