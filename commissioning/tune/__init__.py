"""Measure how one joint follows its goals with the servo's present gains, and propose better gains."""
