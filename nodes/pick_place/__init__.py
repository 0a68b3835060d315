"""The pick-and-place application: a node above the stack that uses the controllers as any other client does."""
