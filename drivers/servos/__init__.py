"""Control tables, servo models and servo series."""
