"""Teaching by hand: the arm gives way to a hand, and what the hand has shown becomes a trajectory."""
