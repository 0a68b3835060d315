"""Plots that every report can use: bars, points and time series as SVG, the same bytes for the same numbers."""
