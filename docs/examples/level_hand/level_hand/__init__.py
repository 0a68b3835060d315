"""A controller that keeps what the hand holds level."""
