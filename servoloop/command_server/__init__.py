"""Command socket of a running stack: its connections, the owner of the motion, and what each message does."""
