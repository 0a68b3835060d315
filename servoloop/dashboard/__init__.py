"""Show an arm in a browser or in a terminal, from a running stack, a recording or virtual servos."""
