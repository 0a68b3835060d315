"""Report measured states with controllers that claim no joint (broadcasters)."""
