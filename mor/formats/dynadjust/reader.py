"""DynAdjust's station and measurement files, DNA 3 and DynaML, as a project on the earth."""

from __future__ import annotations

from collections.abc import Iterable
from pathlib import Path

from mor.counting import counted
from mor.formats.draft import Draft
from mor.formats.dynadjust.clusters import put_vectors, read_cluster
from mor.formats.dynadjust.directions import CODE, put_directions, read_directions
from mor.formats.dynadjust.dynaml import pair_of, read_measurement, root_of, stations_of_xml
from mor.formats.dynadjust.lines import Collected, Measurements, beside, marked_lines, read_geoid
from mor.formats.dynadjust.stations import (
    SYSTEMS,
    Station,
    frame_of,
    known_frame,
    put_stations,
    stations_of_lines,
)
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
    found = Measurements(draft, read_geoid(beside(path, ".geo"), draft), lines=lines)
    _begin(found, path.stem, frame)
    while found.at < len(found.lines):
        line = found.at + 1
        try:
            _measurement(found)
        except ValueError as error:
            draft.problem(str(error), min(found.at + 1, len(found.lines)))
            found.at = max(found.at, line)
    return _finish(found, stations, stations_of_lines(stations, draft), frame)


def read_dynaml(path: Path) -> Document:
    """The project of a pair of files ``…stn.xml`` and ``…msr.xml``, by one of them. Raises :class:`InputError`.

    Geoid heights and deflections are those of a file ``.geo`` beside them; without it heights are ellipsoidal.
    """
    stations, measured, name = pair_of(path)
    draft = Draft(str(measured))
    root = root_of(measured)
    frame = known_frame(root.attributes.get("referenceframe", ""), root.line, draft)
    found = Collected(draft, read_geoid(measured.with_name(f"{name}.geo"), draft))
    _begin(found, name, frame)
    for element in root.all("DnaMeasurement"):
        try:
            read_measurement(found, element)
        except ValueError as error:
            draft.problem(str(error), element.line)
    return _finish(found, stations, stations_of_xml(stations), frame)


def _begin(found: Collected, title: str, frame: str) -> None:
    found.draft.put("title", title)
    found.draft.put("units", {"length": "m", "angle": "dms"})
    heights = "orthometric" if found.geoid else "ellipsoidal"
    found.draft.put("world", {"crs": f"EPSG:{SYSTEMS[frame]}", "heights": heights}, 1)


def _finish(found: Collected, file: Path, stations: Iterable[Station], frame: str) -> Document:
    put_vectors(found)
    put_directions(found)
    put_lines(found)
    if not found.draft.data.get("observations"):
        found.draft.problem("there are no observations that are followed")
    put_stations(file, stations, found, frame)
    _tell(found, found.draft)
    return found.draft.finish()


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
    if code == CODE:
        read_directions(found)
    elif code in KINDS:
        read_line(found, code)
    elif code in LEFT_OUT:
        found.skip(LEFT_OUT[code], found.at + 1)
    else:
        known = ", ".join(sorted(["G", "X", "Y", CODE, *KINDS, *LEFT_OUT]))
        raise ValueError(f"found the measurement {code!r}, expected one of {known}")
    found.at += 1


def _tell(found: Collected, draft: Draft) -> None:
    for what, lines in found.left_out.items():
        draft.note(f"not read: {what} ({len(lines)})", lines[0])
    frames = [name for name in found.frames if name]
    if len(frames) > 1:
        words = f"measurements in {counted(len(frames), 'frame and epoch', 'frames and epochs')} ({', '.join(frames)})"
        draft.note(f"{words} are taken as they are, without transformations", found.frames[frames[1]])
    if not found.geoid:
        draft.note("there is no file .geo beside it: heights are taken as ellipsoidal", 1)
