"""Normal gravity: that of the WGS 84 ellipsoid, from latitude and height alone (equations 1.2)."""

from __future__ import annotations

import numpy as np

EQUATOR_MPS2 = 9.7803253359
SOMIGLIANA = 0.00193185265241
ECCENTRICITY_SQUARED = 0.00669437999014
SEMI_MAJOR_AXIS_M = 6378137.0
FLATTENING = 1 / 298.257223563
CENTRIFUGAL_RATIO = 0.00344978650684  # ratio of centrifugal force at the equator to gravity


def normal_gravity_mps2(latitude_deg: float, height_m: float = 0.0) -> float:
    """Normal gravity at a geodetic latitude and a height above the ellipsoid.

    Somigliana's closed form with terms of height up to the second order. Real gravity differs by the local anomaly,
    tens of mGal (1 mGal is about 1 ppm): the value supports a scale factor in m/s² to 30 to 50 ppm; a survey is better.
    Raises ValueError for a latitude beyond ±90°.
    """
    if not -90 <= latitude_deg <= 90:
        raise ValueError(f"latitude {latitude_deg:g}°: latitudes are from -90° to 90°, north positive")
    sine_squared = np.sin(np.radians(latitude_deg)) ** 2
    surface_mps2 = EQUATOR_MPS2 * (1 + SOMIGLIANA * sine_squared) / np.sqrt(1 - ECCENTRICITY_SQUARED * sine_squared)
    height = height_m / SEMI_MAJOR_AXIS_M
    gradient = 2 * (1 + FLATTENING + CENTRIFUGAL_RATIO - 2 * FLATTENING * sine_squared)
    return float(surface_mps2 * (1 - gradient * height + 3 * height**2))
