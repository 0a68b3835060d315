"""Sensor of the virtual camera: exposure, noise, white balance, vignetting and the sRGB curve. n: number of pixels."""

from dataclasses import dataclass
from math import sqrt
from typing import Any, Final

import numpy as np
from numpy.typing import NDArray

from sim_backend.camera.light import Light, rgb_of_temperature
from sim_backend.compiled import compiled

FloatArray = NDArray[np.float64]

FULL_WELL_E: Final = 8000.0
"""Number of electrons in a saturated pixel of a small webcam sensor."""
ELECTRONS_LUX_S: Final = 400.0
"""Electrons per second that a white surface causes in a pixel, per lux."""
READ_NOISE_E: Final = 4.0
LONGEST_S: Final = 1.0 / 30.0
SHORTEST_S: Final = 1e-4
"""Limits of the exposure time, in seconds."""
MOST_GAIN: Final = 16.0
METERED: Final = 0.35
"""Mean brightness that automatic exposure aims at, as a fraction of a saturated pixel's brightness."""
BRIGHT: Final = 0.9
"""Maximum brightness of the 98th percentile with automatic exposure."""
METER_STEP: Final = 16
"""Step between the pixels that automatic exposure samples: every 16th pixel."""
CURVE_STEPS: Final = 4096
NOISE_VALUES: Final = 1 << 20
"""Number of random values. The number must be a power of 2 and larger than the number of values in an image."""
NOISE_SEED: Final = 7


@dataclass(frozen=True, slots=True)
class Sensor:
    """Sensor settings."""

    exposure_s: float | None = None
    """Fixed exposure time, with gain 1; None for automatic exposure."""
    white_k: float = 5500.0
    """Color temperature of light under which a gray surface appears gray in the image."""
    vignetting: float = 0.15
    """Relative loss of light in the image corners."""
    noisy: bool = True


class Film:
    """Converter from the light that reaches a camera's pixels to images."""

    def __init__(self, sensor: Sensor, width: int, height: int) -> None:
        self._sensor = sensor
        self._shape = (height, width, 3)
        x, y = np.meshgrid(np.linspace(-1.0, 1.0, width) * width, np.linspace(-1.0, 1.0, height) * height)
        self._vignette = (1.0 - sensor.vignetting * (x * x + y * y) / (width**2 + height**2)).ravel()
        self._noise = np.random.default_rng(NOISE_SEED).standard_normal(NOISE_VALUES, dtype=np.float32)
        share = np.arange(CURVE_STEPS) / (CURVE_STEPS - 1)
        encoded = np.where(share <= 0.0031308, 12.92 * share, 1.055 * share ** (1.0 / 2.4) - 0.055)
        self._curve = (255.0 * encoded + 0.5).astype(np.uint8)

    def picture(self, radiance: FloatArray, light: Light, seed: int) -> NDArray[np.uint8]:
        """Convert radiances (n, 3), which are relative to a fully lit white surface, to an image (height, width, 3)."""
        balance = rgb_of_temperature(light.temperature_k) / rgb_of_temperature(self._sensor.white_k)
        exposure, full_e = self._exposure(radiance[::METER_STEP], light, balance)
        offset = int(np.random.default_rng((seed, 3)).integers(NOISE_VALUES))
        read_e = READ_NOISE_E if self._sensor.noisy else 0.0
        shot = 1.0 / full_e if self._sensor.noisy else 0.0
        picture = np.empty((len(radiance), 3), np.uint8)
        _expose(
            radiance, self._vignette, exposure * balance, (shot, (read_e / full_e) ** 2), self._noise, offset,
            self._curve, picture,
        )  # fmt: skip
        return picture.reshape(self._shape)

    def _exposure(self, metered: FloatArray, light: Light, balance: FloatArray) -> tuple[float, float]:
        """Return the brightness of a white surface, and the number of electrons in a saturated pixel."""
        white_e_s = ELECTRONS_LUX_S * light.illuminance_lux
        if self._sensor.exposure_s is not None:
            return white_e_s * self._sensor.exposure_s / FULL_WELL_E, FULL_WELL_E
        seen = metered * balance
        bright = float(np.quantile(seen.max(axis=1), 0.98))
        wanted = min(METERED / max(float(seen.mean()), 1e-6), BRIGHT / max(bright, 1e-6))
        if white_e_s <= 0.0:
            return 0.0, FULL_WELL_E / MOST_GAIN
        time_s = wanted * FULL_WELL_E / white_e_s
        gain = min(max(time_s / LONGEST_S, 1.0), MOST_GAIN)
        time_s = min(max(time_s / gain, SHORTEST_S), LONGEST_S)
        return white_e_s * time_s * gain / FULL_WELL_E, FULL_WELL_E / gain


@compiled
def _expose(
    radiance: FloatArray, vignette: FloatArray, gains: FloatArray, noise: tuple[float, float], values: Any,
    offset: int, curve: Any, picture: Any,
) -> None:  # fmt: skip
    """Store the values of all pixels. ``noise`` consists of the variance per unit of brightness and the constant
    variance."""
    shot, read = noise
    mask, last = len(values) - 1, len(curve) - 1
    for n in range(len(radiance)):
        for i in range(3):
            value = radiance[n, i] * gains[i] * vignette[n]
            value += sqrt(value * shot + read) * values[(offset + 3 * n + i) & mask]
            picture[n, i] = curve[int(min(max(value, 0.0), 1.0) * last + 0.5)]
