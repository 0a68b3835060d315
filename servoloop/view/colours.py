"""The colours of joints by what they are shown for."""

import math
from typing import Final

import numpy as np

from hal.types import FloatArray
from servoloop.view.shapes import Rgb

PLAIN, TEMPERATURE, LOAD = "as described", "temperature", "load"
CHOICES: Final = (PLAIN, TEMPERATURE, LOAD)
COLD_C: Final = 25.0
HOT_C: Final = 70.0
"""At which servos of the STS series switch themselves off, as they come."""
SCALE: Final = np.array([(62, 121, 214), (74, 176, 110), (240, 196, 60), (214, 48, 40)])
STEPS: Final = 24
"""So many colours at the most: a servo's noise is not worth a message to the browser."""


def colour(share: float) -> Rgb | None:
    """The colour from blue (0) by green and yellow to red (1); None for NaN."""
    if math.isnan(share):
        return None
    at = round(min(1.0, max(0.0, share)) * STEPS) / STEPS * (len(SCALE) - 1)
    low = min(int(at), len(SCALE) - 2)
    red, green, blue = np.round(SCALE[low] + (at - low) * (SCALE[low + 1] - SCALE[low])).astype(int).tolist()
    return red, green, blue


def shares(choice: str, temperature_c: FloatArray, effort: FloatArray, limit: FloatArray) -> FloatArray:
    """How far up the scale each joint (n,) is: temperature from 25 to 70 °C, load as a share of the effort limit."""
    if choice == TEMPERATURE:
        return (temperature_c - COLD_C) / (HOT_C - COLD_C)
    if choice == LOAD:
        return np.abs(effort) / limit
    return np.full(len(effort), math.nan)
