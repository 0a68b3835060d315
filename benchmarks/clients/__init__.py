"""Drivers to compare, implemented as benchmark clients."""
