"""What MoveIt must know of an arm, made of the arm's folder."""
