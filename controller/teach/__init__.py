"""Teaching by hand: the arm yields to a hand, and the recorded motion becomes a trajectory."""
