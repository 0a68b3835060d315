"""The pick-and-place application, a node that uses the controllers of the stack like any other client."""
