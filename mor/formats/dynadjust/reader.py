"""DynAdjust's station and measurement files (DNA 3) as a project on the earth."""

from __future__ import annotations

from pathlib import Path

from mor.counting import counted
from mor.formats.draft import Draft
from mor.formats.dynadjust.clusters import put_vectors, read_cluster
from mor.formats.dynadjust.lines import Measurements, beside, marked_lines, read_geoid
from mor.formats.dynadjust.stations import SYSTEMS, frame_of, put_stations
from mor.formats.dynadjust.terrestrial import KINDS, LEFT_OUT, put_lines, read_line
from mor.project.file.nodes import Document


def read_dynadjust(path: Path) -> Document:
    """The project of a pair of files ``.stn`` and ``.msr``, by one of them. Raises :class:`InputError`.

    Geoid heights and deflections are those of a file ``.geo`` beside them; without it heights are ellipsoidal.
    """
    stations, measured = (beside(path, end) for end in (".stn", ".msr"))
    draft = Draft(str(measured))
    lines = marked_lines(measured, draft)
    frame = frame_of(lines, draft)
    found = Measurements(lines, draft, read_geoid(beside(path, ".geo"), draft))
    draft.put("title", path.stem)
    draft.put("units", {"length": "m", "angle": "dms"})
    heights = "orthometric" if found.geoid else "ellipsoidal"
    draft.put("world", {"crs": f"EPSG:{SYSTEMS[frame]}", "heights": heights}, 1)
    while found.at < len(found.lines):
        line = found.at + 1
        try:
            _measurement(found)
        except ValueError as error:
            draft.problem(str(error), min(found.at + 1, len(found.lines)))
            found.at = max(found.at, line)
    put_vectors(found)
    put_lines(found)
    if not draft.data.get("observations"):
        draft.problem("there are no observations that are followed")
    put_stations(stations, found, frame)
    _tell(found, draft)
    return draft.finish()


def _measurement(found: Measurements) -> None:
    text = found.lines[found.at]
    code = text[:1]
    if code == "*" or not text.strip():
        found.at += 1
        return
    if not code.strip():
        raise ValueError("values without a measurement before them")
    if code in "GXY":
        read_cluster(found, code)
        return
    if code in KINDS:
        read_line(found, code)
    elif code in LEFT_OUT:
        found.skip(LEFT_OUT[code])
    else:
        known = ", ".join(sorted(["G", "X", "Y", *KINDS, *LEFT_OUT]))
        raise ValueError(f"found the measurement {code!r}, expected one of {known}")
    found.at += 1
    while code in LEFT_OUT and _continues(found):
        found.at += 1


def _continues(found: Measurements) -> bool:
    text = found.lines[found.at] if found.at < len(found.lines) else ""
    return bool(text.strip()) and not text[:1].strip()


def _tell(found: Measurements, draft: Draft) -> None:
    for what, lines in found.left_out.items():
        draft.note(f"not read: {what} ({len(lines)})", lines[0] + 1)
    frames = [name for name in found.frames if name]
    if len(frames) > 1:
        words = f"measurements in {counted(len(frames), 'frame and epoch', 'frames and epochs')} ({', '.join(frames)})"
        draft.note(f"{words} are taken as they are, without transformations", found.frames[frames[1]])
    if not found.geoid:
        draft.note("there is no file .geo beside it: heights are taken as ellipsoidal", 1)
