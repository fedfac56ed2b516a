"""A STAR*NET network in the making: its options, points and observations, and the σ that lines do not give."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field

from mor.formats.draft import Draft, Row, number
from mor.formats.starnet.lines import Line, degrees

SIGMA = {"angle": 4.0, "direction": 4.0, "bearing": 4.0, "zenith": 10.0}
"""σ of observations that have none, seconds of arc."""
SIGMA_DISTANCE, SIGMA_HEIGHT, SIGMA_LEVEL = 0.002, 0.015, 0.002
"""m, m of an elevation difference, m on the square root of a kilometre."""
FIXED = {"angle": 0.01, "direction": 0.01, "bearing": 0.01, "zenith": 0.01, "distance": 1e-5, "height": 1e-5}
"""σ in place of !: seconds of arc, m."""
COLUMNS = {
    "distance": ("from", "to", "distance", "sigma", "from_height", "to_height"),
    "horizontal_distance": ("from", "to", "distance", "sigma"),
    "zenith_angle": ("from", "to", "zenith_angle", "sigma", "from_height", "to_height"),
    "height_difference": ("from", "to", "dz", "sigma"),
    "bearing": ("from", "to", "bearing", "sigma"),
    "angle": ("at", "from", "to", "angle", "sigma"),
    "directions": ("station", "set", "to", "horizontal", "sigma"),
}
NAMES = ("from", "to", "at", "station")
Values = tuple[str | float | None, ...]


@dataclass
class Network:
    """Content read so far, and the options in force."""

    draft: Draft
    plane: bool = False
    delta: bool = False
    """Horizontal distances and elevation differences in place of slope distances and zenith angles."""
    east_first: bool = False
    from_first: bool = False
    metres: float = 1.0
    gon: bool = False
    separator: str = "-"
    """What stands between names."""
    defaults: int = 0
    tables: dict[str, list[Row]] = field(default_factory=dict)
    points: dict[str, tuple[list[str | None], list[str | None], int]] = field(default_factory=dict)
    """Coordinates and σ (0: fixed, empty: free) of each point, with the line."""
    station: str = ""
    sets: dict[str, int] = field(default_factory=dict)
    traverse: list[Line] = field(default_factory=list)
    skipped: dict[str, list[int]] = field(default_factory=dict)

    def add(self, type_: str, values: Values, line: int) -> None:
        """A row of observations, none where its σ is that of a free one."""
        if "*" in values:
            self.skip("free observations (*)", line)
            return
        cells = [None if v is None else v if isinstance(v, str) else repr(float(v)) for v in values]
        self.tables.setdefault(type_, []).append(Row(cells, line))
        for name in (str(v) for v, column in zip(values, COLUMNS[type_], strict=True) if column in NAMES):
            self.points.setdefault(name, ([None] * 3, [None] * 3, line))

    def skip(self, what: str, line: int) -> None:
        """A line that is not read."""
        self.skipped.setdefault(what, []).append(line)

    def angle(self, text: str) -> float:
        """An angle in degrees."""
        return number(text) * 0.9 if self.gon else degrees(text)

    def length(self, text: str) -> float:
        """A length in metres."""
        return number(text) * self.metres

    def sigma(self, words: Sequence[str], place: int, kind: str) -> str | float:
        """σ of an angle (degrees) or a length (m) at a place among the words behind the values."""
        word = words[place] if place < len(words) else "&"
        angular = kind in SIGMA
        if word == "*":
            return "*"
        if word == "!":
            return FIXED[kind] / (3600.0 if angular else 1.0)
        if word != "&":
            value = number(word)
            if value <= 0.0:
                raise ValueError(f"found the σ {word}, expected a number above 0, !, * or &")
            return value * (9e-5 if self.gon else 1.0 / 3600.0) if angular else value * self.metres
        self.defaults += 1
        if angular:
            return SIGMA[kind] / 3600.0
        return SIGMA_DISTANCE if kind == "distance" else SIGMA_HEIGHT
