"""Plan motions of an arm around obstacles, from its arm folder."""
