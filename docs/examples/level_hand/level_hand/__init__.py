"""A controller that keeps the hand and the object in it level."""
