"""σ of observations that come from commands (#ds_error 20 mm 10 ppm), not from their lines."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from mor.arrays import FloatArray
from mor.formats.snap.lines import Words

_METRES = {"mm": 1e-3, "m": 1.0}
_SECONDS = {"sec": 1.0, "secs": 1.0, "seconds": 1.0, "min": 60.0, "deg": 3600.0, "degrees": 3600.0}


class Error(NamedTuple):
    """Parts of a σ that are added as squares."""

    seconds: float = 0.0
    metres: float = 0.0
    """Of a length; of an angle the error of centring across the sight."""
    ppm: float = 0.0
    level: float = 0.0
    """Of zenith distances: the error of centring along the level, m."""
    vertical: float = 0.0

    def of_length(self, length: float) -> float:
        """σ of a length."""
        return float(np.hypot(self.metres, 1e-6 * self.ppm * length))

    def of_angle(self, length: float, level: float) -> float:
        """σ of an angle, arc seconds, over a slope distance and its level part."""
        if not length:
            return self.seconds
        across = np.hypot(self.metres / max(level, 1e-3), self.vertical * level / length**2)
        raised = self.level * np.sqrt(max(length**2 - level**2, 0.0)) / length**2
        return float(np.hypot(self.seconds, np.degrees(np.hypot(across, raised)) * 3600.0))


def error_of(words: Words) -> Error:
    """The σ that a command says: numbers with their units. Raises ``ValueError``."""
    found = dict.fromkeys(Error._fields, 0.0)
    while words:
        value, unit = words.number("a number"), words.take("a unit").lower()
        if value < 0.0:
            raise ValueError(f"found {value:g}, expected an error of 0 or more")
        if unit in _SECONDS:
            found["seconds"] = value * _SECONDS[unit]
        elif unit in _METRES:
            found["metres"] = value * _METRES[unit]
        elif unit in ("mmh", "mmv"):
            found["level" if unit == "mmh" else "vertical"] = value * 1e-3
        elif unit == "ppm":
            found["ppm"] = value
        else:
            raise ValueError(f"found the unit {unit!r}, expected sec, mm, m, ppm, mmh or mmv")
    return Error(**found)


class VectorError(NamedTuple):
    """Errors east, north, up of vectors and positions."""

    metres: tuple[float, ...] = (0.0, 0.0, 0.0)
    ppm: tuple[float, ...] = (0.0, 0.0, 0.0)
    """Of the length of a vector."""
    relative: bool = False
    """True if members of a set have errors relative to each other (mmr, ppmr)."""

    def variances(self, length: float) -> FloatArray:
        """(3,) east, north, up."""
        result: FloatArray = np.array(self.metres) ** 2 + (1e-6 * length * np.array(self.ppm)) ** 2
        return result


def vector_error_of(words: Words) -> VectorError:
    """Errors of ``20 30 50 mm 10 25 100 ppm``. Raises ``ValueError``."""
    found = VectorError()
    while words:
        values = tuple(words.number("errors east, north and up") for _ in range(3))
        unit = words.take("a unit").lower()
        if min(values) < 0.0:
            raise ValueError("found a negative error, expected 0 or more")
        if unit in _METRES:
            found = found._replace(metres=tuple(value * _METRES[unit] for value in values))
        elif unit == "ppm":
            found = found._replace(ppm=values)
        elif unit in ("mmr", "ppmr"):
            found = found._replace(relative=True)
        else:
            raise ValueError(f"found the unit {unit!r}, expected mm, ppm, mmr or ppmr")
    return found
