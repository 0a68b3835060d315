"""Command socket of a running stack: its connections, the client that controls the arm, and the effects of messages."""
