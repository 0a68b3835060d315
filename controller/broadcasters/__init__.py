"""Broadcasters: controllers that claim no joint and pass measured states on."""
