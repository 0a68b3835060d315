"""Control a running arm manually with on-screen buttons, keys and named poses."""
