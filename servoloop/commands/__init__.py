"""The commands of the command line: they parse arguments, call the other packages and print results."""
