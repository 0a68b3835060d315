"""Grade the apples in an image: find and measure them, assess their skin, and compare the results with thresholds."""
