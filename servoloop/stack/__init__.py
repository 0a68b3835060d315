"""Build, run and shut down the control stack of one robot."""
