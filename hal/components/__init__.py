"""Hardware components with life cycles of their own, as one hardware for the loop."""
