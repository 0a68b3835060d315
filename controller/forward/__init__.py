"""Forward the latest message as a position, velocity or effort command."""
