"""Teaching by hand: the user moves the compliant arm, and the recorded motion becomes a trajectory."""
