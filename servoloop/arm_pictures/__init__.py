"""Pictures of an arm in a pose, with its joints' names and directions."""
