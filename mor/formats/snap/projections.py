"""EPSG codes of the projections that SNAP knows by the names of New Zealand's meridional circuits."""

from __future__ import annotations

from mor.errors import nearest

_CIRCUITS = (
    ("EDEN", 5),
    ("PLEN", 6),
    ("POVE", 7),
    ("HAWK", 8),
    ("TARA", 9),
    ("TUHI", 10),
    ("WANG", 11),
    ("WAIR", 12),
    ("WELL", 13),
    ("COLL", 14),
    ("NELS", 15),
    ("KARA", 16),
    ("BULL", 17),
    ("GREY", 18),
    ("AMUR", 19),
    ("MARL", 20),
    ("HOKI", 21),
    ("OKAR", 22),
    ("JACK", 23),
    ("PLEA", 24),
    ("GAWL", 25),
    ("TIMA", 26),
    ("LIND", 27),
    ("NICH", 28),
    ("YORK", 29),
    ("OBSE", 30),
    ("BLUF", 32),
)
"""Their letters, and the last digits of the codes: 272.. of 1949, 21.. of 2000."""
PROJECTIONS = {
    "NZMG": "EPSG:27200",
    "NZTM": "EPSG:2193",
    **{f"{name}TM1949": f"EPSG:{27200 + number}" for name, number in _CIRCUITS},
    **{f"{name}TM2000": f"EPSG:{2100 + number}" for name, number in _CIRCUITS},
}


def projection_of(name: str) -> str:
    """EPSG code of a projection. Raises ``ValueError``."""
    if name.upper() not in PROJECTIONS:
        raise ValueError(f"projection {name!r} is not known{nearest(name.upper(), PROJECTIONS)}")
    return PROJECTIONS[name.upper()]
