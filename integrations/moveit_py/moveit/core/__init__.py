"""Robot models, states and trajectories, and the messages that are created from them."""
