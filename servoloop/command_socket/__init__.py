"""Messages of the command socket of a running stack, and a client that sends them (docs/socket.md)."""
