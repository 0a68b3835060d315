"""The programs: the command line, and the control stack that is put together from all other folders."""
