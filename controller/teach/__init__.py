"""Teaching by hand: the user moves the compliant arm, and the recorded motion is converted to a trajectory."""
