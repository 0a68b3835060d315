"""Search for paths, shortcuts, and times along a path."""
