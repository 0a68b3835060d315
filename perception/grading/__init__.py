"""Grade the apples of an image: find and measure them, judge their skin, and compare the results with thresholds."""
