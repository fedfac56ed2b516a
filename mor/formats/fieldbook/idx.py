"""Leica IDX: sections of POINTS, SETUP and SLOPE; the header says the units."""

from __future__ import annotations

import csv
from pathlib import Path

from mor.formats.draft import Draft, number
from mor.formats.fieldbook.book import FieldBook, Sight, records, sexagesimal
from mor.project.file.nodes import Document

_SLOPE = ("TGTNO", "TGTID", "CFGNO", "HZ", "VZ", "SDIST", "REFHT")
_IGNORED = (
    "VERSION",
    "SYSTEM",
    "UNITS",
    "TEMP",
    "PRESS",
    "TIME",
    "PROJECT",
    "NAME",
    "OPERATOR",
    "CREATION_DATE",
)


_GIVEN = ("", "FIX", "FIXED", "CTRL", "CONTROL", "REF", "NONE")
"""Classes of points whose coordinates were not computed from readings; MEAS, AVGE, EST and others were."""


def read_idx(path: Path) -> Document:
    """The project of an IDX file. Raises :class:`InputError` with every mistake found."""
    draft = Draft(str(path))
    reader = _Reader(FieldBook(draft))
    for line, text in records(path, draft):
        try:
            reader.line(text.strip(), line)
        except ValueError as error:
            draft.problem(str(error), line)
    reader.book.finish(reader.title or path.stem)
    return draft.finish()


class _Reader:
    """The section the reading is in, and the columns its head declares."""

    def __init__(self, book: FieldBook) -> None:
        self.book, self.title = book, ""
        self.section, self.columns = "", [""]
        self.sexagesimal, self.metres = True, 1.0

    def line(self, text: str, line: int) -> None:
        """One line of the file."""
        word, _, rest = text.partition("\t") if "\t" in text else text.partition(" ")
        head = word.split("(")[0].upper()
        if not text:
            return
        if "(" in text and text.endswith(")") and "," in text:
            self.section = head
            self.columns = [name.strip().upper() for name in text[text.index("(") + 1 : -1].split(",")]
        elif head == "END":
            self.section = ""
        elif text.endswith(";") and self.section in ("POINTS", "SLOPE", "THEMINFO", "ANNOTATIONS", "CONFIGS"):
            self._row(next(csv.reader([text[:-1].replace("\t", " ")], skipinitialspace=True)), line)
        else:
            self._key(head, rest.strip().rstrip(";").strip().strip('"'), line)

    def _key(self, head: str, value: str, line: int) -> None:
        if head == "ANGULAR":
            self._angles(value.upper(), line)
        elif head == "LINEAR":
            if value.upper() not in ("METRE", "METER", "FEET", "FOOT"):
                raise ValueError(f"found the unit {value!r} of lengths, expected METRE or FEET")
            self.metres = 0.3048 if value.upper().startswith("F") else 1.0
        elif head == "NAME" and not self.title:
            self.title = value
        elif head == "STN_ID":
            self.book.set_up(value, line)
        elif head == "INST_HT":
            if self.book.set_ups:
                self.book.set_ups[-1].height = number(value) * self.metres
        elif head in ("STN_NO", "HEADER", "DATABASE", "THEODOLITE", "SETUP", *_IGNORED):
            return
        else:
            row = "rows before the head of their section" if head[:1].isdigit() else f"{head} records"
            self.book.leave_out(f"{self.section} records" if self.section else row, line)

    def _angles(self, value: str, line: int) -> None:
        if value not in ("DMS", "GON", "DEG", "DD"):
            raise ValueError(f"found the unit {value!r} of angles, expected DMS, GON or DEG")
        self.sexagesimal = value == "DMS"
        self.book.angle = "gon" if value == "GON" else "deg"

    def _row(self, cells: list[str], line: int) -> None:
        values = dict(zip(self.columns, (cell.strip() for cell in cells), strict=False))
        if self.section == "POINTS":
            place = [values.get(name, "") for name in ("EAST", "NORTH", "ELEVATION")]
            if any(place):
                east, north, up = (number(text) * self.metres if text else None for text in place)
                given = values.get("CLASS", "") in _GIVEN
                add = self.book.point if given else self.book.computed_point
                add(values.get("POINTID", ""), east, north, up, line)
        elif self.section == "SLOPE":
            self._slope(values, line)
        else:
            self.book.leave_out(f"{self.section} records", line)

    def _slope(self, values: dict[str, str], line: int) -> None:
        missing = [name for name in _SLOPE if name not in values]
        if missing:
            raise ValueError(f"found no {', '.join(missing)}, expected {', '.join(_SLOPE)}")
        angle = sexagesimal if self.sexagesimal else number
        slope = number(values["SDIST"]) * self.metres
        sight = Sight(
            values["TGTID"],
            line,
            angle(values["HZ"]),
            angle(values["VZ"]),
            slope or None,
            height=number(values["REFHT"] or "0") * self.metres,
        )
        self.book.sight(sight)
