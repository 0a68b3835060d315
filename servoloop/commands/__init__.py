"""The command line's tools, a module for each group of verbs: they read arguments, call commissioning/ and print."""
