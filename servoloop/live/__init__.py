"""Looking on at a running stack, or at a recording of one."""
