"""Layout of texts and figures: columns, numbers, colours."""

from __future__ import annotations

import math
import re
import textwrap
from collections.abc import Collection, Mapping, Sequence
from typing import Any, NamedTuple

import numpy as np

from mor.errors import MOST_TOLD, escaped
from mor.report.language import ENGLISH, Words
from mor.types import FloatArray

# ---- Columns and paragraphs of text that fit a page: 100 signs wide, whatever names and headings are in them.

WIDTH = 100
_GAPS = ("  ", " ")
"""What stands between columns: the second where the first is too wide."""


def drawn(headers: Sequence[str], rows: Sequence[Sequence[str]], left: Collection[int], margin: int = 0) -> str:
    """Columns with a line under their headers; those of ``left`` hold texts, the others numbers.

    Columns are as wide as their widest cell and two wider than their header. Where that is too wide for a page, headers
    are broken at their blanks, but for the one before a unit; then texts are; then the columns are cut into blocks that
    all begin with the first one. ``margin``: blanks that every line begins with.
    """
    cells = [[escaped(cell.strip()) for cell in row] for row in (headers, *rows)]
    widest = [max((len(row[k]) for row in cells[1:]), default=0) for k in range(len(headers))]
    widths = [max(width, len(header) + 2) for width, header in zip(widest, cells[0], strict=True)]
    gap = _GAPS[0]
    page = WIDTH - margin
    # A unit that stays with its quantity; figure spaces stand in no report.
    of_unit = "\u2007["
    if _total(widths) > page:
        cells[0] = [header.replace(" [", of_unit) for header in cells[0]]
        heads = [max(map(len, header.split(" "))) for header in cells[0]]
        widths = [max(pair) for pair in zip(widest, heads, strict=True)]
        gap = next((gap for gap in _GAPS if _total(widths, gap) <= page), gap)
        widths = _narrowed(widths, left, page) if gap == _GAPS[0] else widths
    text = "\n\n".join(
        _block(
            [[row[k] for k in block] for row in cells],
            [widths[k] for k in block],
            {place for place, k in enumerate(block) if k in left},
            gap,
        )
        for block in _blocks(widths, gap, page)
    ).replace(of_unit, " [")
    return textwrap.indent(text, " " * margin)


def _total(widths: Sequence[int], gap: str = _GAPS[0]) -> int:
    return sum(widths) + len(gap) * (len(widths) - 1)


def _narrowed(widths: list[int], left: Collection[int], page: int) -> list[int]:
    """Widths with the columns of texts made narrower, the widest first, as far as the page wants it."""
    widths = list(widths)
    texts = [k for k in range(len(widths)) if k in left]
    while texts and _total(widths) > page:
        widest = max(texts, key=lambda k: widths[k])
        # Signs down to which a column of texts is narrowed before the table is cut into blocks.
        if widths[widest] <= 12:
            break
        widths[widest] -= 1
    return widths


def _blocks(widths: Sequence[int], gap: str, page: int) -> list[list[int]]:
    blocks = [[0]]
    for k in range(1, len(widths)):
        if len(blocks[-1]) > 1 and _total([widths[i] for i in (*blocks[-1], k)], gap) > page:
            blocks.append([0])
        blocks[-1].append(k)
    return blocks


def _block(cells: Sequence[Sequence[str]], widths: Sequence[int], left: Collection[int], gap: str) -> str:
    lines = []
    for number, row in enumerate(cells):
        parts = [
            textwrap.wrap(cell, width, break_on_hyphens=False) if len(cell) > width else [cell]
            for cell, width in zip(row, widths, strict=True)
        ]
        height = max(map(len, parts))
        for part in parts:
            missing = [""] * (height - len(part))
            part[:] = [*missing, *part] if number == 0 else [*part, *missing]
        for line in zip(*parts, strict=True):
            placed = [
                cell.ljust(width) if k in left else cell.rjust(width)
                for k, (cell, width) in enumerate(zip(line, widths, strict=True))
            ]
            lines.append(gap.join(placed).rstrip())
        if number == 0:
            lines.append(gap.join("-" * width for width in widths))
    return "\n".join(lines)


def paragraphs(text: str) -> str:
    """Lines that are too long broken at blanks; the further ones stand below where their text began."""
    return "\n".join(_paragraph(line) for line in text.split("\n"))


def _paragraph(line: str) -> str:
    if len(line) <= WIDTH:
        return line
    lead = re.match(r"\S.{0,38}?\s{2,}(?=\S)", line)
    mark = re.match(r"\s*(\d+\. )?", line)
    indent = lead.end() if lead else (mark.end() if mark else 0) + 2
    # An equals sign that stays with what is on both of its sides.
    tied = "\u2007=\u2007"
    return textwrap.fill(
        line.replace(" = ", tied),
        WIDTH,
        subsequent_indent=" " * indent,
        break_long_words=False,
        break_on_hyphens=False,
        replace_whitespace=False,
        drop_whitespace=True,
    ).replace(tied, " = ")


# ---- Headings and tables of the text report.

DIGITS = {"m": 5, "mm": 4, "cm": 4, "dm": 5, "um": 2, "km": 8, "ft": 5, "us-ft": 5, "in": 4}
ANGLE_DIGITS = {"gon": 5, "deg": 6, "rad": 8, "mrad": 5, "mgon": 3}


def heading(title: str) -> str:
    """A section heading, in the words of its language."""
    return f"{title}\n{'-' * min(len(title), WIDTH)}"


def titled(title: str) -> list[str]:
    """The title of a report, underlined."""
    return [title, "=" * min(len(title), WIDTH)]


def aligned(facts: Sequence[tuple[str, str]]) -> list[str]:
    """Names and texts in two columns."""
    width = max(len(name) for name, _ in facts)
    return [f"{name.ljust(width)}  {text}" for name, text in facts]


ALL = 1_000_000_000
"""Rows of a section of which nothing is left out."""


def table(
    headers: Sequence[str],
    rows: Sequence[Sequence[str]],
    left: int = 1,
    words: Words = ENGLISH,
    last_left: bool = False,
    margin: int = 0,
) -> str:
    """A table of texts: the first ``left`` columns, and the last where wanted, to the left, numbers to the right."""
    texts = {*range(left), *([len(headers) - 1] if last_left else [])}
    # Columns that hold words of the program, not names of the user.
    listed = ("status", "flag", "action", "kind")
    rows = [
        [
            words.listed(cell) if header in listed else cell if k in texts else words.number(cell)
            for k, (header, cell) in enumerate(zip(headers, row, strict=True))
        ]
        for row in rows
    ]
    return drawn([words.header(header) for header in headers], rows, texts, margin)


def correlation_table(names: Sequence[str], matrix: Sequence[Sequence[float]], words: Words) -> str:
    """The lower triangle of a correlation matrix; names of components are the same in every language."""
    rows = [[name, *(words.number(fixed(x, 3)) for x in matrix[k][: k + 1])] for k, name in enumerate(names)]
    return drawn(["", *names], [[*row, *[""] * (len(names) + 1 - len(row))] for row in rows], {0}, 0)


def fixed(value: float | None, digits: int) -> str:
    """A number with fixed decimals; a dash where there is none."""
    return "-" if value is None or not math.isfinite(value) else f"{value:z.{digits}f}"


def digits_worth(value: float, sigma: float | None) -> int:
    """Significant digits of a value that its σ makes worth printing: to about a hundredth of it."""
    if sigma is None or not sigma > 0.0 or value == 0.0:
        return 10
    return int(np.clip(np.floor(np.log10(abs(value))) - np.floor(np.log10(sigma)) + 3, 3, 10))


def sigma_decimals(sigmas: FloatArray, digits: int = 2) -> int:
    """Decimals with which nearly every one of some σ has so many digits: one number for a whole column."""
    known = np.sort(sigmas[np.isfinite(sigmas) & (sigmas > 0.0)])
    if not len(known):
        return digits
    small = known[int(0.1 * len(known))]
    return int(np.clip(digits - 1 - np.floor(np.log10(small)), 0, 9))


def short(value: float | None, digits: int = 6) -> str:
    """A number with significant digits; a dash where there is none."""
    return "-" if value is None or not math.isfinite(value) else f"{value:.{digits}g}"


def cells(row: Mapping[str, Any], columns: str, dash: str = "-", minus: str = "-") -> list[str]:
    """Cells of a record by the names of its columns: ``name`` as it is, ``name:.3f`` and ``name:.4g`` as a number.

    A dash stands where there is none; zero with fixed decimals has no sign.
    """
    said = []
    for column in columns.split():
        name, _, form = column.partition(":")
        value = row[name]
        if value is None or (form and not math.isfinite(value)):
            said.append(dash)
        else:
            way = f"z{form}" if form.endswith("f") else form
            said.append(format(value, way).replace("-", minus) if form else str(value))
    return said


def probability(value: float | None) -> str:
    """A probability with four decimals, for pages and paper."""
    return "–" if value is None else "< 0.0001" if value < 1e-4 else f"{value:.4f}"


def coverage_words(factor: float, freedom: float, words: Words) -> str:
    """Factor, probability and distribution of an expanded uncertainty; ``freedom`` of σ0, infinite a priori."""
    from mor.quality.test_statistics import coverage_probability

    return words(
        "U = k sigma, k = {k}: coverage probability {p} % ({distribution}; JCGM 100:2008)",
        k=f"{factor:g}",
        p=f"{100.0 * coverage_probability(factor, freedom):.2f}",
        distribution=words("normal distribution")
        if math.isinf(freedom)
        else words("Student's t, {freedom:degree|degrees} of freedom", freedom=int(freedom)),
    )


def in_words(row: dict[str, Any], words: Words) -> str:
    """Return the name of an observation: its type, its point and station names, and its component."""
    return f"{row_in_words(row, words)}{component_of(row)}"


def row_in_words(row: dict[str, Any], words: Words) -> str:
    """Return the name of the row of an observation: its type, its point and station names."""
    names = ", ".join(f"{words.listed(key)} {_name(key, name, words)}" for key, name in row["names"].items())
    type_ = "" if next(iter(row["names"]), "") == row["type"] else f"{row['type']} "
    return f"{type_}{names}"


def _name(key: str, name: str, words: Words) -> str:
    kind, space, rest = name.partition(" ")
    return f"{words.listed(kind)}{space}{rest}" if key == "of" else name


def component_of(row: dict[str, Any]) -> str:
    """The component after a comma; nothing if it is the type once more, as of a distance."""
    return "" if row["component"] == row["type"] else f", {row['component']}"


# ---- Colours of charts: the set of Okabe and Ito, told apart by colour-blind readers, on light and on dark ground.

BLUE = "#3b8fd0"
ORANGE = "#e69f00"
GREEN = "#009e73"
RED = "#d55e00"
PURPLE = "#cc79a7"
GREY = "#8a8f98"
BAND = "rgba(59,143,208,0.22)"

DIVERGING = [[0.0, "#b35806"], [0.25, "#f1a340"], [0.5, "#f7f7f7"], [0.75, "#998ec3"], [1.0, "#542788"]]
"""Brown to purple through white: signs that colour-blind readers tell apart (C. Brewer, PuOr)."""


# ---- Classes of a histogram of test values, as many for a gross error of a million σ as for none.

BIN_WIDTH = 0.25
OUTERMOST = 10.0
"""|w| that has a place of its own; larger ones stand in the outermost classes. N(0, 1) has none at all there."""


class Bins(NamedTuple):
    """Edges of the classes, the test values with those beyond the edges moved into the last class, their number."""

    edges: FloatArray
    w: FloatArray
    beyond: int

    @property
    def limit(self) -> float:
        """The last edge."""
        return -float(self.edges[0])


def normal_bins(w: FloatArray, critical: float) -> Bins:
    """Classes for test values (n,), wide enough for the critical value and for |w| up to :data:`OUTERMOST`."""
    largest = float(np.abs(w).max(initial=1.0))
    limit = max(min(float(np.ceil(largest * 2.0) / 2.0), OUTERMOST), float(np.ceil(critical + 0.5)))
    edges = np.linspace(-limit, limit, round(2.0 * limit / BIN_WIDTH) + 1)
    inside = limit - 0.5 * BIN_WIDTH
    return Bins(edges, np.clip(w, -inside, inside), int(np.count_nonzero(np.abs(w) > limit)))


# ---- Last section of the report: inputs, program, signature.

LINE = "_" * 30


def persons(identity: dict[str, Any], words: Words = ENGLISH) -> list[tuple[str, str]]:
    """Who and when, for the head; what the project does not say is left out."""
    rows = [(key, identity[key] or "") for key in ("client", "operator", "measured", "date", "remarks")]
    rows = [("input as of" if key == "date" else key, text) for key, text in rows if text]
    return [(words(name), " ".join(text.split())) for name, text in rows]


def section(
    identity: dict[str, Any], words: Words = ENGLISH, notes: Sequence[dict[str, Any]] = (), shown: int = MOST_TOLD
) -> str:
    """Program, options, input files with their SHA-256, what was noted of them, and the place for the signature."""
    rows = [(words("program"), identity["program"]), (words("options"), " ".join(identity["options"]) or words("none"))]
    lines = [heading(words("About this report")), *aligned(rows)]
    if identity["inputs"]:
        lines += ["", words("Read from ({count:file|files}), with SHA-256:", count=len(identity["inputs"]))]
    for file in identity["inputs"]:
        said = words("{count:byte|bytes}", count=file["bytes"])
        lines += [f"  {file['file']}, {said}", f"    {file['sha256']}"]
    if notes:
        lines += ["", f"{words('Notes on what was read')}:", *(_note(row, words) for row in notes[:shown])]
    if len(notes) > shown:
        more = len(notes) - shown
        lines.append(words("{count:more note is|more notes are} in results.json.", count=more))
    return "\n".join([*lines, "", *signature(words)])


def signature(words: Words) -> list[str]:
    """The lines to sign on."""
    return ["", f"{LINE}    {LINE}", f"{words('place and date').ljust(len(LINE))}    {words('signature')}"]


def _note(row: dict[str, Any], words: Words) -> str:
    line = f":{row['line']}" if row["line"] else ""
    place = f"{row['file']}{line}: " if row["file"] else ""
    return f"  {place}{words.told(row['message'])}"


# ---- Charts as plain data: a chart is its traces and a layout whose axes carry names and units.

Figure = dict[str, Any]


def figure(traces: list[dict[str, Any]], x: str, y: str, **layout: Any) -> Figure:
    """A chart with named axes."""
    axes = {"xaxis": {"title": {"text": x}}, "yaxis": {"title": {"text": y}}}
    for name in axes:
        axes[name] |= layout.pop(name, {})
    return {"data": traces, "layout": {**axes, **layout}}


def numbers(values: FloatArray) -> list[float | None]:
    """Numbers with six significant digits, ``None`` if there is none."""
    return [float(f"{value:.6g}") if np.isfinite(value) else None for value in values.tolist()]


def joined(start: FloatArray, end: FloatArray) -> tuple[FloatArray, FloatArray]:
    """x and y of separate lines from start to end (n, 2), with gaps (NaN) between them."""
    gap = np.full(len(start), np.nan)
    x, y = (np.column_stack([start[:, k], end[:, k], gap]).ravel() for k in (0, 1))
    return x, y


def ellipse_lines(centre: FloatArray, covariance: FloatArray, scale: float, count: int) -> FloatArray:
    """(n, count, 2) lines of ellipses about centres (n, 2): the unit circle under a square root of the covariance."""
    values, vectors = np.linalg.eigh(covariance)
    root = vectors * np.sqrt(np.maximum(values, 0.0))[:, None, :]
    t = np.linspace(0.0, 2.0 * np.pi, count)
    around = np.einsum("nij,tj->nti", root, np.column_stack([np.cos(t), np.sin(t)]))
    return np.asarray(centre[:, None, :] + scale * around)


def round_length(value: float) -> float:
    """The largest of 1, 2, 5 · 10ᵏ that does not exceed a positive value; 1 for anything else."""
    if not np.isfinite(value) or value <= 0.0:
        return 1.0
    power = 10.0 ** np.floor(np.log10(value))
    return float(power * max(step for step in (1.0, 2.0, 5.0) if step * power <= value * (1.0 + 1e-12)))


def small_unit(unit: str, size: float) -> tuple[str, float]:
    """Unit and factor in which a size in ``unit`` reads well: µm instead of 0.0004 mm."""
    if unit == "mm" and size < 0.05:
        return "µm", 1e3
    if unit == "m" and size < 0.1:
        return ("mm", 1e3) if size >= 1e-4 else ("µm", 1e6)
    return unit, 1.0


# ---- The frame of a figure: the bulk of the places. Places far away stand at its edge, with their distance.


def frame_of(places: FloatArray) -> tuple[FloatArray, FloatArray] | None:
    """Least and largest coordinates of the bulk of places (n, k), or None if no place is far away."""
    known = places[np.isfinite(places).all(axis=1)]
    if not len(known):
        return None
    distance = np.linalg.norm(known - np.median(known, axis=0), axis=1)
    # Median distances from the median place beyond which a place does not widen the frame.
    bulk = known[distance <= 10.0 * np.median(distance)]
    if len(bulk) in (0, len(known)) or not np.ptp(bulk, axis=0).any():
        return None
    return bulk.min(axis=0), bulk.max(axis=0)


def at_edge(xy: FloatArray, low: FloatArray, high: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Places (n, 2) with those outside of a frame moved to its edge, and how far (n,) each was moved.

    The way goes along the line to the middle of the frame.
    """
    middle, half = 0.5 * (low + high), 0.5 * (high - low)
    # Height of a frame in parts of its width, at least.
    half = np.maximum(half, 0.05 * half.max())
    times = np.max(np.abs(xy - middle) / half, axis=1)[:, None]
    edge = np.where(times > 1.0 + 1e-6, middle + (xy - middle) / np.maximum(times, 1.0), xy)
    return edge, np.linalg.norm(xy - edge, axis=1)


def with_distances(names: Sequence[str], distances: FloatArray, unit: str) -> list[str]:
    """Names, followed by the distance from the edge of the frame if it is not zero."""
    return [
        f"{name}, {short(distance, max(3, len(str(int(distance)))))} {unit}" if distance > 0.0 else name
        for name, distance in zip(names, distances, strict=True)
    ]


# ---- Place labels in a figure without overlap.

NO_MARKS = np.zeros((0, 2))


def placed(
    marks: FloatArray, size: FloatArray, edge: FloatArray, others: FloatArray = NO_MARKS
) -> list[tuple[int, tuple[float, float]]]:
    """Number of those names that have room, the first ones first, and of each the offset of its middle from its mark.

    ``marks`` (n, 2) are the places of what is named, ``others`` (m, 2) those of further marks, ``size`` (n, 2) width
    and height of the names, ``edge`` the least and the largest x and y of the picture (x, y, x, y).
    """
    every = np.concatenate([marks, others])
    # Half the width of a mark.
    labels_mark = 3.0
    taken = np.concatenate([every - labels_mark, every + labels_mark], axis=1)
    found = []
    for k, (mark, (width, height)) in enumerate(zip(marks, size, strict=True)):
        side, above = 0.5 * width + 1.4 * labels_mark, 0.5 * height + 1.2 * labels_mark
        for x, y in ((1, 1), (1, -1), (-1, 1), (-1, -1), (0, 1), (0, -1)):
            offset = np.array([x * side, y * (above if x == 0 else 0.5 * height)])
            half = 0.5 * np.array([width, height])
            box = np.concatenate([mark + offset - half, mark + offset + half])
            if (box[:2] < edge[:2]).any() or (box[2:] > edge[2:]).any():
                continue
            if ((box[:2] < taken[:, 2:]) & (taken[:, :2] < box[2:])).all(axis=1).any():
                continue
            taken = np.concatenate([taken, box[None]])
            found.append((k, (float(offset[0]), float(offset[1]))))
            break
    return found
