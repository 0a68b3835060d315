"""The view: an arm in a browser, from a running stack or from a recording."""
