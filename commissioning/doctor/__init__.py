"""Diagnose an arm: measure it, check the measurements, and rank the findings by likely cause."""
