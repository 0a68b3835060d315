"""Search for paths, shorten them, and compute their timing."""
