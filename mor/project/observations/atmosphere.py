"""First velocity correction of measured distances, from temperature, pressure and humidity of the air.

    d = d′ + (C − D p/(273.15 + t) + 11.27 e/(273.15 + t)) · 10⁻⁶ d′

with t in °C, p in hPa and the partial pressure e of water vapour in hPa (Rüeger, *Electronic Distance Measurement*, 4th
ed., 1996, eq. 6.15). C = (n_REF − 1) · 10⁶ belongs to the instrument, D to its carrier wavelength λ, µm, through the
group refractivity of Barrell and Sears (1939):

    D = 273.15/1013.25 · (287.604 + 4.8864/λ² + 0.068/λ⁴)
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from mor.arrays import FloatArray
from mor.project.edge import Edge, UnitError
from mor.project.file.model import Observations
from mor.project.network.reading import Reading
from mor.project.tables.columns import Column, tell_rows
from mor.project.tables.statuses import number_column
from mor.project.tables.tables import Place, Rows
from mor.units import LENGTH, NUMBER

TEMPERATURE, PRESSURE, HUMIDITY, VAPOUR = "temperature", "pressure", "humidity", "vapour_pressure"
AIR = (TEMPERATURE, PRESSURE, HUMIDITY, VAPOUR)
"""Columns of the air: °C, hPa, %, hPa."""
_ZERO = 273.15
_LIMITS = {
    TEMPERATURE: (-90.0, 60.0, "°C"),
    PRESSURE: (300.0, 1100.0, "hPa"),
    HUMIDITY: (0.0, 100.0, "%"),
    VAPOUR: (0.0, 100.0, "hPa"),
}
"""What is found on the earth; beyond it the unit is another one."""


class Air(NamedTuple):
    """The air along n sights; °C, hPa, hPa."""

    temperature: FloatArray
    pressure: FloatArray
    vapour: FloatArray


def vapour_pressure(temperature: FloatArray, humidity: FloatArray) -> FloatArray:
    """Partial pressure of water vapour, hPa, at t (°C) and the relative humidity (%), by Magnus' formula."""
    saturated = 6.1078 * np.exp(17.269 * temperature / (237.3 + temperature))
    pressure: FloatArray = 0.01 * humidity * saturated
    return pressure


def dispersion_constant(wavelength: float) -> float:
    """D of a carrier wavelength, µm."""
    return _ZERO / 1013.25 * (287.604 + 4.8864 / wavelength**2 + 0.068 / wavelength**4)


def first_velocity_correction(air: Air, C: float, D: float) -> FloatArray:
    """(n,) correction per unit of length."""
    absolute = _ZERO + air.temperature
    correction: FloatArray = 1e-6 * (C - D * air.pressure / absolute + 11.27 * air.vapour / absolute)
    return correction


def air_columns(edge: Edge) -> list[Column]:
    """Columns of the air at a distance."""
    return [number_column(name, NUMBER, edge) for name in AIR]


def corrected(
    reading: Reading, entry: Observations, rows: Rows, given: FloatArray, place: Place
) -> FloatArray:
    """Distances (n, 1) with their first velocity corrections, where the table has columns of the air."""
    found = {name: rows.number(name) for name in AIR}
    if not any(np.isfinite(values).any() for values in found.values()):
        return given
    constants = _constants(reading, entry, place)
    before = len(reading.problems)
    for name, (least, most, unit) in _LIMITS.items():
        words = f"{name}: expected a value between {least:g} and {most:g} {unit}"
        tell_rows(reading.problems, (found[name] < least) | (found[name] > most), rows, words)
    lost = np.isnan(found[TEMPERATURE]) | np.isnan(found[PRESSURE])
    words = "a distance with a column of the air needs both temperature and pressure"
    tell_rows(reading.problems, lost, rows, words)
    both = np.isfinite(found[HUMIDITY]) & np.isfinite(found[VAPOUR])
    tell_rows(reading.problems, both, rows, "give either humidity or vapour_pressure")
    if constants is None or len(reading.problems) > before:
        return given
    vapour = np.where(
        np.isfinite(found[VAPOUR]),
        found[VAPOUR],
        np.nan_to_num(vapour_pressure(found[TEMPERATURE], found[HUMIDITY])),
    )
    correction = first_velocity_correction(Air(found[TEMPERATURE], found[PRESSURE], vapour), *constants)
    return given * (1.0 + correction[:, None])


def _constants(reading: Reading, entry: Observations, place: Place) -> tuple[float, float] | None:
    """C and D of the instrument of a group; told where they are missing."""
    name = entry.instrument
    instrument = reading.project.instruments.get(name) if name is not None else None
    if instrument is None or instrument.atmosphere is None:
        words = "temperature, pressure: the instrument has no atmosphere: {C: 286.34, D: 80.67} or {C, wavelength}"
        reading.problems.append(place.problem(words, "instrument"))
        return None
    said = instrument.atmosphere
    if said.wavelength is None:
        assert said.D is not None  # the model sees to it
        return said.C, said.D
    try:
        length = reading.edge.number(said.wavelength, LENGTH) * reading.edge.metres * 1e6
    except UnitError as error:
        reading.problems.append(
            reading.at("instruments", str(name), "atmosphere").problem(f"wavelength: {error}")
        )
        return None
    if not _SHORTEST <= length <= _LONGEST:
        words = f"wavelength: found {said.wavelength}, expected one of light, as 0.658 um"
        reading.problems.append(reading.at("instruments", str(name), "atmosphere").problem(words))
        return None
    return said.C, dispersion_constant(length)


_SHORTEST, _LONGEST = 0.36, 2.0
"""Wavelengths, µm, at which Barrell and Sears hold and distances are measured with light."""
