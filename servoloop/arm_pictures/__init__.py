"""Draw images of an arm with the names and directions of its joints."""
