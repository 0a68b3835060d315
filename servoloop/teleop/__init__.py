"""Implementation of ``servoloop teleop``: a follower arm follows a leader arm that a person moves by hand."""
