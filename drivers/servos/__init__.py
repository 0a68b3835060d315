"""Servo models as data: control tables, models and series."""
