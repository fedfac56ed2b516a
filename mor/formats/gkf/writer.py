"""A network as GNU Gama's XML: metres and gon with all their digits, σ in mm and cc."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path
from xml.sax.saxutils import escape, quoteattr

import numpy as np

from mor.errors import InputError, Message
from mor.formats.content import Content, ContentTable, content_of, not_carried, points
from mor.formats.draft import Written
from mor.formats.gkf.reader import ANGULAR, CC, GON, NAMES, PARTS
from mor.formats.networks import ObservationTable, groups, heights_of, stations, tilted_stations
from mor.model.observation_types import PLAIN_TYPES
from mor.project.document import Document
from mor.project.schema import Datum
from mor.types import FloatArray


def write_gkf(document: Document, folder: Path, target: Path) -> Written:
    """The network; what GNU Gama has no place for is noted. Raises :class:`InputError` for what it cannot say."""
    content = content_of(document, folder)
    problems = tilted_stations(content, "GNU Gama")
    if content.project.axes.bearings_from != "north":
        problems.append(content.place("axes").problem("GNU Gama counts bearings from north"))
    if problems:
        raise InputError(problems)
    axes, settings = content.project.axes, content.project.settings
    angles = "left-handed" if axes.angles == "clockwise" else "right-handed"
    found = points(content)
    # gama-local leaves out what misses the given coordinates by more (mm); mor leaves nothing out by itself.
    lines = [
        '<?xml version="1.0" encoding="UTF-8"?>',
        '<gama-local xmlns="http://www.gnu.org/software/gama/gama-local">',
        f'<network axes-xy="{axes.xy}" angles="{angles}">',
        f"<description>{escape(content.project.title)}</description>",
        f'<parameters sigma-apr="{settings.sigma0!r}" conf-pr="{1.0 - settings.global_level:.10g}" '
        f'tol-abs="1e9" sigma-act="{settings.sigma}"/>',
        "<points-observations>",
        *_points(found, content),
        *_observed_points(found, content),
    ]
    known = stations(content)
    for cluster in _clusters(groups(content, PARTS)):
        lines += _observations(cluster, known, content.edge.metres)
    text = "\n".join([*lines, "</points-observations>", "</network>", "</gama-local>"]) + "\n"
    notes = not_carried(content, tuple(PARTS), ("stations",), "GNU Gama")
    if content.project.images or content.project.cameras:
        notes.append(Message("GNU Gama has no images", str(target)))
    entries = content.project.observations
    if any(e.instrument or e.centring for e in entries):
        notes.append(Message("GNU Gama cannot store scales, offsets, refraction and σ of centring", str(target)))
    if any(e.ppm for e in entries):
        notes.append(Message("σ that grow with the distance are written as they are at the observed one", str(target)))
    return Written({target: text.encode()}, notes)


def _points(found: ContentTable, content: Content) -> Iterator[str]:
    """Points with their coordinates: fixed, adjusted, or adjusted and constrained, by position and height."""
    dimensions, problems = content.project.settings.dimensions, []
    constrained = _constrained(found, content)
    metres = content.edge.metres
    for k, name in enumerate(found.ids):
        values, free = found.values[k], found.statuses.free[k]
        inside = [f'{c}="{v * metres!r}"' for c, v in zip("xyz", values.tolist(), strict=True) if np.isfinite(v)]
        fixed, adjusted = "", ""
        for part in (part for part in ("xy", "z") if part in dimensions):
            statuses = {bool(free["xyz".index(c)]) for c in part}
            if len(statuses) > 1:
                words = f"point {name!r}: GNU Gama fixes x and y together or not at all"
                problems.append(Message(words, content.document.file))
            elif statuses == {False}:
                fixed += part
            else:
                adjusted += part.upper() if (name, part) in constrained else part
        inside += [f'fix="{fixed}"'] if fixed else []
        inside += [f'adj="{adjusted}"'] if adjusted else []
        yield f"<point id={quoteattr(name)} {' '.join(inside)}/>"
    if problems:
        raise InputError(problems)


def _constrained(found: ContentTable, content: Content) -> set[tuple[str, str]]:
    """Points and parts that carry the datum of a free network."""
    datum = content.project.datum
    if datum == "fixed":
        return set()
    groups_ = {table.group: k for k, table in enumerate(content.project.points) if table.group}
    if isinstance(datum, Datum) and (datum.minimal is not None or groups_):
        raise InputError([content.place("datum").problem("GNU Gama has inner constraints over named points only")])
    names = datum.free if isinstance(datum, Datum) else "all"
    if names == "all":
        names = {"xyz": list(found.ids)}
    by_components = names if isinstance(names, dict) else {"xyz": list(names)}
    return {
        (name, part)
        for components, chosen in by_components.items()
        for name in chosen
        for part in ("xy", "z")
        if part in components
    }


def _observed_points(found: ContentTable, content: Content) -> list[str]:
    """Coordinates with σ, as observed ones without correlation."""
    metres = content.edge.metres
    lines, variances = [], []
    for k, name in enumerate(found.ids):
        sigma = found.statuses.sigma[k] * metres * 1e3
        seen = [c for c in range(3) if np.isfinite(sigma[c])]
        if seen:
            values = " ".join(f'{"xyz"[c]}="{float(found.statuses.values[k, c]) * metres!r}"' for c in seen)
            lines.append(f"<point id={quoteattr(name)} {values}/>")
            variances += [float(sigma[c]) ** 2 for c in seen]
    if not lines:
        return []
    matrix = f'<cov-mat dim="{len(variances)}" band="0">{" ".join(map(repr, variances))}</cov-mat>'
    return ["<coordinates>", *lines, matrix, "</coordinates>"]


def _clusters(found: list[ObservationTable]) -> list[list[ObservationTable]]:
    clusters: dict[str, list[ObservationTable]] = {}
    for number, group in enumerate(found):
        clusters.setdefault(group.entry.cluster or f"\0{number}", []).append(group)
    return list(clusters.values())


def _observations(cluster: list[ObservationTable], known: dict[str, tuple[str, float]], metres: float) -> list[str]:
    """Elements of tables: by station and set where they have sets, else one after the other."""
    sections: dict[tuple[str, str], list[str]] = {}
    units: list[float] = []
    factors: list[float] = []
    given = next((group for group in cluster if group.covariance is not None), None)
    for group in cluster:
        face = np.nan_to_num(group.rows.number("face"), nan=1.0)
        written = np.stack(
            [part.value(group.values[:, k], face) for k, part in enumerate(PARTS[group.entry.type])], axis=1
        )
        for row in range(group.rows.count):
            references = {r.name: group.rows.text(r.name)[row] for r in PLAIN_TYPES[group.entry.type].references}
            section = _section(group, references, row)
            heights = heights_of(group, references, row, known, metres)
            station = references.get("station")
            if station is not None:
                references = {"from": known.get(station, (station, 0.0))[0], "to": references["to"]}
            elements = _elements(group, references, heights, written[row], row, metres, given is None)
            sections.setdefault(section, []).extend(elements)
            seen = np.isfinite(written[row])
            units += [
                _unit(part.element, metres) for part, there in zip(PARTS[group.entry.type], seen, strict=True) if there
            ]
            factors += group.factors[: len(seen)][seen].tolist()
    if given is not None:
        sections = _merged(sections)
    if given is not None and len(sections) > 1:
        words = f"observations {given.entry.name or given.entry.type}: one covariance over several sets"
        raise InputError([Message(f"GNU Gama cannot store {words}", given.rows.file)])
    matrix = [] if given is None else [_matrix(given, np.array(units), np.array(factors))]
    lines = []
    for name, elements in sections.items():
        lines += [f"<{name[0]}>", *elements, *matrix, f"</{name[0]}>"]
    return lines


def _merged(sections: dict[tuple[str, str], list[str]]) -> dict[tuple[str, str], list[str]]:
    """Sets at different stations in one section, where each station has one: a matrix belongs to a section."""
    stations = [key.partition("\0")[0] for kind, key in sections if kind == "obs"]
    if len(stations) != len(sections) or len(set(stations)) < len(stations):
        return sections
    return {("obs", ""): [element for elements in sections.values() for element in elements]}


def _unit(element: str, metres: float) -> float:
    """Internal units per unit of the σ that GNU Gama has: cc, mm."""
    return CC if element in ANGULAR else 1e-3 / metres


def _section(group: ObservationTable, references: dict[str, str], row: int) -> tuple[str, str]:
    element = PARTS[group.entry.type][0].element
    sections = {"dh": "height-differences", "vec": "vectors", "point": "coordinates"}
    if element in sections:
        return sections[element], ""
    if "station" in references:
        return "obs", f"{references['station']}\0{group.rows.text('set')[row]}"
    return "obs", ""


def _elements(
    group: ObservationTable,
    references: dict[str, str],
    heights: tuple[float, float],
    values: FloatArray,
    row: int,
    metres: float,
    with_sigma: bool,
) -> list[str]:
    attributes = NAMES.get(group.entry.type, {})
    named = " ".join(f"{attributes.get(n, n)}={quoteattr(v)}" for n, v in references.items())
    result: dict[str, list[str]] = {}
    for k, part in enumerate(PARTS[group.entry.type]):
        if not np.isfinite(values[k]):
            continue
        number = float(values[k] / GON if part.element in ANGULAR else values[k] * metres)
        inside = result.setdefault(part.element, [f"<{part.element} {named}"])
        inside.append(f'{part.attribute}="{number!r}"')
        if with_sigma:
            inside.append(f'stdev="{float(group.sigma[row, k]) / _unit(part.element, metres)!r}"')
        if part.element in ("s-distance", "z-angle") and any(heights):
            inside.append(f'from_dh="{heights[0]!r}" to_dh="{heights[1]!r}"')
    return [f"{' '.join(inside)}/>" for inside in result.values()]


def _matrix(group: ObservationTable, units: FloatArray, factors: FloatArray) -> str:
    covariance = np.array(group.covariance)
    own = factors if group.entry.covariance is not None else np.ones(len(units))
    scale = own / units
    scaled = covariance * np.outer(scale, scale)
    size = len(scaled)
    rows = [" ".join(repr(v) for v in scaled[k, k:].tolist()) for k in range(size)]
    return f'<cov-mat dim="{size}" band="{size - 1}">{" ".join(rows)}</cov-mat>'
