"""Grade the apples of a picture: find and measure them, judge their skin, and compare the results with thresholds."""
