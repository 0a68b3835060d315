"""Report measured states with controllers that do not claim any joints (broadcasters)."""
