"""Control a running arm manually with held buttons, held keys and named poses."""
