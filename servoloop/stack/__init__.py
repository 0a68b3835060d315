"""The control stack of one robot: how it is built, run and ended."""
