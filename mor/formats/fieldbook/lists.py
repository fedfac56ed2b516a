"""Field books of comma-separated records: Nikon RAW, Topcon GTS-7, Sokkia SCR."""

from __future__ import annotations

from pathlib import Path

from mor.formats.draft import Draft, number
from mor.formats.fieldbook.book import FieldBook, Sight, sexagesimal
from mor.formats.text import read_lines
from mor.project.file.nodes import Document


def _optional(text: str) -> float | None:
    return number(text) if text.strip() else None


def _cells(text: str, count: int) -> list[str]:
    """The cells of a record, with empty ones behind it."""
    cells = [cell.strip() for cell in text.split(",")]
    return cells + [""] * (count - len(cells))


def read_nikon(path: Path) -> Document:
    """The project of a Nikon RAW file (version 2). Raises :class:`InputError` with every mistake found.

    CO comments with the units, MC coordinates, ST station (instrument height in its 6th cell), F1 F2 a sight in either
    face, SS side shot, SO point staked out: name, target height, slope, horizontal circle, zenith.
    """
    draft = Draft(str(path))
    book = FieldBook(draft)
    state = {"angle units": "DDDMMSS", "coord order": "NEZ", "dist units": "Metres"}
    for line, text in enumerate(read_lines(path, draft), start=1):
        try:
            _nikon(text, line, book, state)
        except ValueError as error:
            draft.problem(str(error), line)
    if _NO_ANGLES in book.skipped:
        for set_up in book.set_ups:
            for sight in set_up.sights:
                book.leave_out(_NO_ANGLES, sight.line)
            set_up.sights = []
    book.finish(path.stem)
    return draft.finish()


_NO_ANGLES = "all sights: angles of some of them are none in the unit that the head says"


def _nikon(text: str, line: int, book: FieldBook, state: dict[str, str]) -> None:
    kind, *rest = _cells(text, 8)
    metres = 1.0 if state["dist units"].lower().startswith("met") else 0.3048
    if kind == "CO":
        key, sign, value = text[3:].partition(":")
        known = key.strip().lower()
        if sign and known in state:
            state[known] = value.strip()
            book.angle = "gon" if "gon" in state["angle units"].lower() else "deg"
        else:
            book.leave_out("comments", line)
    elif kind == "MC":
        first, second, up = (None if v is None else v * metres for v in map(_optional, rest[2:5]))
        place = (first, second) if state["coord order"].upper().startswith("E") else (second, first)
        book.point(rest[0], *place, up, line)
    elif kind == "ST":
        book.set_up(rest[0], line, (_optional(rest[4]) or 0.0) * metres)
    elif kind in ("F1", "F2", "SS", "SO"):
        shift = 1 if kind == "SO" else 0
        name, height, slope, circle, zenith = (rest[0], *rest[1 + shift : 5 + shift])
        if not name:
            book.leave_out("sights without a point", line)
            return
        read = number if book.angle == "gon" else sexagesimal
        try:
            angles = [read(cell) if cell else None for cell in (circle, zenith)]
        except ValueError:
            book.leave_out(_NO_ANGLES, line)
            return
        book.sight(
            Sight(
                name,
                line,
                angles[0],
                angles[1],
                (_optional(slope) or 0.0) * metres or None,
                height=(_optional(height) or 0.0) * metres,
                face=2 if kind == "F2" else 0,
            )
        )
    elif text.strip():
        book.leave_out(f"records {kind}", line)


def read_topcon(path: Path) -> Document:
    """The project of a Topcon GTS-7 file. Raises :class:`InputError` with every mistake found.

    STN station and instrument height, BS and SS target and its height, then HV circle and zenith, SD with the slope
    distance. The order of XYZ is not said in the file: they are left out.
    """
    draft = Draft(str(path))
    book = FieldBook(draft)
    target: list[str] = []
    metres, read = 1.0, sexagesimal
    for line, text in enumerate(read_lines(path, draft), start=1):
        kind = text[:8].strip()
        cells = _cells(text[8:], 3)
        try:
            if kind == "UNITS":
                metres = 1.0 if cells[0].upper().startswith("M") else 0.3048
                book.angle = "gon" if cells[1].upper().startswith("G") else "deg"
                read = number if book.angle == "gon" else sexagesimal
            elif kind == "STN":
                book.set_up(cells[0], line, (_optional(cells[1]) or 0.0) * metres)
            elif kind in ("BS", "SS", "FS", "OBS"):
                target = cells
            elif kind in ("HV", "SD") and target:
                slope = number(cells[2]) * metres if kind == "SD" else None
                height = (_optional(target[1]) or 0.0) * metres
                book.sight(
                    Sight(target[0], line, read(cells[0]), read(cells[1]), slope or None, height=height)
                )
            elif kind == "XYZ":
                book.leave_out("coordinates: the file does not say which of them is north", line)
            elif text.strip():
                book.leave_out(f"records {kind or text.strip()[:8]}", line)
        except ValueError as error:
            draft.problem(str(error), line)
    book.finish(path.stem)
    return draft.finish()


def read_sokkia_scr(path: Path) -> Document:
    """The project of a Sokkia SCR file. Raises :class:`InputError` with every mistake found.

    M instrument and its height; then name, kind (Ea slope, zenith, circle; Ee zenith, circle), code, mark, height of
    the target.
    """
    draft = Draft(str(path))
    book = FieldBook(draft)
    for line, text in enumerate(read_lines(path, draft), start=1):
        cells = _cells(text, 9)
        try:
            if cells[0] == "M":
                book.set_up(f"station {len(book.set_ups) + 1}", line, _optional(cells[4]) or 0.0)
                draft.note(f"the file names no station: it is called station {len(book.set_ups)}", line)
            elif cells[1] == "Ea":
                slope, zenith, circle = number(cells[6]), sexagesimal(cells[7]), sexagesimal(cells[8])
                height = _optional(cells[4]) or 0.0
                book.sight(Sight(cells[0], line, circle, zenith, slope or None, height=height))
            elif cells[1] == "Ee":
                zenith, circle = sexagesimal(cells[6]), sexagesimal(cells[7])
                book.sight(Sight(cells[0], line, circle, zenith, height=_optional(cells[4]) or 0.0))
            elif text.strip():
                book.leave_out(f"records {cells[0]}", line)
        except ValueError as error:
            draft.problem(str(error), line)
    book.finish(path.stem)
    return draft.finish()
