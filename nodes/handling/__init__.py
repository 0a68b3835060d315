"""Moving a running arm by hand from a program: only as long as somebody says so."""
