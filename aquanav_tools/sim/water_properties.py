"""Density and viscosity of water by temperature and salinity, at the pressure of the surface.

Source: Sharqawy, Lienhard and Zubair, Thermophysical properties of seawater: a review of existing correlations and
data, Desalination and Water Treatment 16 (2010), equations 8 (density, 0.1 %) and 22 and 23 (viscosity, 1.5 %).
"""

from __future__ import annotations

SALT_PER_GRAM = 1e-3
"""kg/kg per g/kg."""


def water_density(temperature: float, salinity: float) -> float:
    """Return the density, kg/m^3, at 0 to 180 degrees Celsius and 0 to 160 g/kg of salt."""
    t, s = temperature, SALT_PER_GRAM * salinity
    fresh = 999.9 + 2.034e-2 * t - 6.162e-3 * t**2 + 2.261e-5 * t**3 - 4.657e-8 * t**4
    return fresh + s * (802.0 - 2.001 * t + 1.677e-2 * t**2 - 3.060e-5 * t**3) - 1.613e-5 * s**2 * t**2


def water_viscosity(temperature: float, salinity: float) -> float:
    """Return the dynamic viscosity, Pa s, at 0 to 180 degrees Celsius and 0 to 150 g/kg of salt."""
    t, s = temperature, SALT_PER_GRAM * salinity
    fresh = 4.2844e-5 + 1.0 / (0.157 * (t + 64.993) ** 2 - 91.296)
    first = 1.541 + 1.998e-2 * t - 9.52e-5 * t**2
    second = 7.974 - 7.561e-2 * t + 4.724e-4 * t**2
    return fresh * (1.0 + first * s + second * s**2)
