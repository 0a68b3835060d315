"""Search for paths, shorten them, and compute the times along them."""
