"""Robot models, states and trajectories, and the messages made from them."""
