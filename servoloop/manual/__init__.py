"""Manual control of a running arm: held buttons and keys, and named poses."""
