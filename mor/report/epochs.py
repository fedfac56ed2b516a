"""Reports of epochs and movements."""

from __future__ import annotations

import json
from collections.abc import Sequence
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
import polars as pl
from markupsafe import Markup, escape
from scipy.special import chdtri

from mor.input_files import note_input
from mor.quality.deformation import Epochs, MovementTest, blocks_of
from mor.quality.solution import Solved
from mor.report.estimates import movement_rows, point_table
from mor.report.identity import Identity, identity_of
from mor.report.language import ENGLISH, Words
from mor.report.layout import DIGITS, fixed, placed, round_length, small_unit
from mor.report.page import asset, environment, running_heads
from mor.report.page_data import covariances, drawn_axes
from mor.report.summary import summary
from mor.report.text_tables import listed_movements, listed_parameters, statements
from mor.types import BoolArray, FloatArray

# ------------------------------------------------------------
# Movements between epochs as a table, in project axes.
# ------------------------------------------------------------


def movement_table(
    names: Sequence[str], tests: Sequence[MovementTest], M: FloatArray, level: float, known: bool
) -> pl.DataFrame:
    """One row for each point or pair: movement, σ, test values (mean squares), p-values, verdict."""
    turned = np.array([test.movement @ M for test in tests]).reshape(-1, 3)
    sigma = np.array([test.sigma @ np.abs(M) for test in tests]).reshape(-1, 3)
    p, p_estimated = (
        np.exp([getattr(test, name) for test in tests]) for name in ("log_p", "log_p_estimated")
    )
    frame = pl.DataFrame(
        {
            "point": list(names),
            **{f"d{axis}": turned[:, k] for k, axis in enumerate("xyz")},
            **{f"sd{axis}": sigma[:, k] for k, axis in enumerate("xyz")},
            "test": [test.statistic for test in tests],
            "test_estimated": [test.ratio for test in tests],
            "freedom": [test.freedom for test in tests],
            "p": p,
            "p_estimated": p_estimated,
            "moved": (p if known else p_estimated) < level,
        }
    )
    return frame.with_columns(pl.col(pl.Float64).fill_nan(None))


def verdict(epochs: Epochs, level: float, known: bool, words: Words = ENGLISH) -> list[str]:
    """The congruence test in words."""
    result = epochs.result
    test = result.global_test
    if test is None or test.freedom == 0:
        return [words("No movement can be tested: no coordinate has a variance.")]
    value = test.statistic if known else test.ratio
    which = (
        words("sigma0 known")
        if known
        else words("pooled sigma0 {sigma0}", sigma0=f"{np.sqrt(result.variance):.4f}")
    )
    sentence = (
        "Global congruence test: {value} against {limit} ({freedom:degree|degrees} of freedom, level {level}, "
        "{which}): congruent, nothing has moved."
        if value <= result.critical
        else "Global congruence test: {value} against {limit} ({freedom:degree|degrees} of freedom, level {level}, "
        "{which}): NOT congruent."
    )
    lines = [
        words(
            sentence,
            value=f"{value:.4f}",
            limit=f"{result.critical:.4f}",
            freedom=test.freedom,
            level=f"{level:g}",
            which=which,
        )
    ]
    moved = [name for name, stable in zip(epochs.names, result.stable, strict=True) if not stable]
    if moved:
        lines.append(words("Taken out of the datum as moved: {names}.", names=", ".join(moved)))
    return lines


# ------------------------------------------------------------
# Movements between two epochs as a drawing (SVG): vectors from ellipses of confidence, labels that do not overlap.
# ------------------------------------------------------------

DRAWING_WIDTH = 960
_LEAST, _MOST = 260, 560
"""Heights between which the drawing has that of its network."""
_MARGIN, _LEGEND = 60, 30
_LETTER, _LINE = 6.6, 13.0
"""Width of a letter and height of a line of a label."""
_AROUND = float(np.sqrt(chdtri(2, 0.05)))
"""Semi-axes of an ellipse of 95 % in units of those of 1σ."""
_MOST_LABELS = 400
_TIP = (
    '<defs><marker id="tip" viewBox="0 0 8 8" refX="6" refY="4" markerWidth="4.5" markerHeight="4.5" orient="auto">'
    '<path class="tip" d="M0 0 8 4 0 8z"/></marker></defs>'
)


class Moved(NamedTuple):
    """Points of both epochs: names, places, movements (n, 3) and their covariances (n, 3, 3), in project axes."""

    names: tuple[str, ...]
    places: FloatArray
    movements: FloatArray
    covariances: FloatArray
    moved: BoolArray
    unit: str
    reversed: tuple[bool, bool, bool]
    """Axes that count to the left or downwards in a plan."""
    right: int
    """Which axis is drawn to the right in a plan: 0 or 1."""


def widest_view(places: FloatArray, right: int) -> tuple[int, int]:
    """Axes to the right and upwards: in plan, or in elevation where that shows more of the network."""
    up = 1 - right
    extent = np.ptp(places, axis=0) if len(places) else np.zeros(3)
    if extent[2] <= min(extent[right], extent[up]):
        return right, up
    return (right if extent[right] >= extent[up] else up), 2


def movement_drawing(found: Moved, words: Words = ENGLISH) -> Markup:
    """Points, their movements and ellipses at one scale, with a bar for it; what has moved thick, with its name."""
    axes = widest_view(found.places, found.right)
    xy, factor, height = _on_paper(found, axes)
    signs = np.array([-1.0 if found.reversed[k] else 1.0 for k in axes]) * (1.0, -1.0)
    vectors = found.movements[:, axes] * signs
    covariances = found.covariances[:, axes][:, :, axes] * np.outer(signs, signs)
    scale = _scale(vectors, covariances)
    parts = [_ellipse(p, c * scale**2) for p, c in zip(xy, covariances, strict=True)]
    parts += [_vector(p, p + scale * v, m) for p, v, m in zip(xy, vectors, found.moved, strict=True)]
    parts += _labels(found, xy, xy + scale * vectors, height)
    parts += [_bar(scale, found.unit, height, words), *_axes(axes, signs, factor, found.unit, height)]
    label = escape(words("Movements between the epochs"))
    return Markup(
        f'<svg class="drawing" viewBox="0 0 {DRAWING_WIDTH} {height:.0f}" role="img" aria-label="{label}">'
        f"{_TIP}{''.join(parts)}</svg>"
    )


def _on_paper(found: Moved, axes: tuple[int, int]) -> tuple[FloatArray, float, float]:
    """Places on the drawing (n, 2), its units per unit of the project, and its height."""
    signs = np.array([-1.0 if found.reversed[k] else 1.0 for k in axes]) * (1.0, -1.0)
    xy = found.places[:, axes] * signs
    low, high = xy.min(axis=0), xy.max(axis=0)
    room = np.array([DRAWING_WIDTH - 2 * _MARGIN, _MOST - 2 * _MARGIN - _LEGEND], dtype=float)
    extent = np.where(high > low, high - low, 1e-300)
    factor = float((room / extent).min()) if (high > low).any() else 1.0
    height = max(float(high[1] - low[1]) * factor + 2 * _MARGIN + _LEGEND, _LEAST)
    middle = np.array([DRAWING_WIDTH / 2.0, (height - _LEGEND) / 2.0])
    placed: FloatArray = (xy - (low + high) / 2.0) * factor + middle
    return placed, factor, height


def _scale(vectors: FloatArray, covariances: FloatArray) -> float:
    """Units of the drawing per unit of movement: the longest of nearly all is a tenth of the drawing."""
    around = _AROUND * np.sqrt(np.maximum(np.trace(covariances, axis1=1, axis2=2), 0.0))
    sizes = np.maximum(np.hypot(vectors[:, 0], vectors[:, 1]), around)
    largest = float(np.quantile(sizes, 0.95)) if len(sizes) else 0.0
    return 0.1 * _MOST / largest if largest > 0.0 else 1.0


def _ellipse(centre: FloatArray, covariance: FloatArray) -> str:
    values, axes = np.linalg.eigh(covariance)
    a, b = _AROUND * np.sqrt(np.maximum(values[::-1], 0.0))
    turn = np.degrees(np.arctan2(axes[1, 1], axes[0, 1]))
    return (
        f'<ellipse cx="{centre[0]:.1f}" cy="{centre[1]:.1f}" rx="{a:.2f}" ry="{b:.2f}" '
        f'transform="rotate({turn:.1f} {centre[0]:.1f} {centre[1]:.1f})"/>'
    )


def _vector(start: FloatArray, end: FloatArray, moved: bool) -> str:
    kind = "moved" if moved else "stable"
    dot = f'<circle class="{kind}" cx="{start[0]:.1f}" cy="{start[1]:.1f}" r="2.2"/>'
    line = f'<line class="{kind}" x1="{start[0]:.1f}" y1="{start[1]:.1f}" x2="{end[0]:.1f}" y2="{end[1]:.1f}"'
    return dot + line + (' marker-end="url(#tip)"/>' if moved else "/>")


def _labels(found: Moved, xy: FloatArray, tips: FloatArray, height: float) -> list[str]:
    """Names, those of moved points first, each where nothing else is; none where there is no such place."""
    order = np.argsort(~found.moved, kind="stable")[:_MOST_LABELS].tolist()
    size = np.array([(_LETTER * len(found.names[k]), _LINE) for k in order]).reshape(-1, 2)
    edge = np.array([0.0, 0.0, DRAWING_WIDTH, height - _LEGEND])
    others = np.concatenate([np.delete(xy, order, axis=0), tips[found.moved]])
    said = []
    for number, offset in placed(xy[order], size, edge, others):
        k = order[number]
        (x, y), weight = xy[k] + offset, ' class="strong"' if found.moved[k] else ""
        said.append(
            f'<text{weight} x="{x:.1f}" y="{y + 4:.1f}" text-anchor="middle">{escape(found.names[k])}</text>'
        )
    return said


def _bar(scale: float, unit: str, height: float, words: Words) -> str:
    length = round_length(0.12 * DRAWING_WIDTH / scale)
    said, factor = small_unit(unit, length)
    y = height - _LEGEND / 2
    text = escape(words("{length} in movements and ellipses (95 %)", length=f"{length * factor:g} {said}"))
    return (
        f'<line class="bar" x1="{_MARGIN}" y1="{y}" x2="{_MARGIN + scale * length:.1f}" y2="{y}"/>'
        f'<text x="{_MARGIN + scale * length + 8:.1f}" y="{y + 4}">{text}</text>'
    )


def _axes(axes: tuple[int, int], signs: FloatArray, factor: float, unit: str, height: float) -> list[str]:
    """A cross with the names of the axes and a bar of the network in the lower right corner."""
    length = round_length(0.2 * DRAWING_WIDTH / factor)
    x, y = DRAWING_WIDTH - _MARGIN - factor * length, height - _LEGEND / 2
    names = ["XYZ"[k] for k in axes]
    arrows = ("→" if signs[0] > 0 else "←"), ("↑" if signs[1] < 0 else "↓")
    return [
        f'<line class="bar" x1="{x:.1f}" y1="{y}" x2="{DRAWING_WIDTH - _MARGIN}" y2="{y}"/>',
        f'<text x="{x - 8:.1f}" y="{y + 4}" text-anchor="end">{names[0]} {arrows[0]} {names[1]} {arrows[1]}, '
        f"{length:g} {unit}</text>",
    ]


# ------------------------------------------------------------
# Movements of a point against time as a small drawing (SVG): its coordinates since the first epoch, with σ.
# ------------------------------------------------------------

WIDTH, HEIGHT = 300, 170
_LEFT, _RIGHT, _TOP, _BOTTOM = 44, 12, 24, 22
_AXES = ("x", "y", "z")
_MARKS = ("M-2.5 0 0-2.5 2.5 0 0 2.5z", "M-2-2H2V2H-2z", "M0-3 2.8 2H-2.8z")
"""Marks of the coordinates, told apart without colours: diamond, square, triangle."""


def series_drawing(
    name: str, years: FloatArray, moved: FloatArray, sigma: FloatArray, unit: str, labels: Sequence[str]
) -> Markup:
    """Movements (n, 3) with σ (n, 3) at years (n,), in ``unit``; ``labels`` of the three coordinates."""
    reach = np.nan_to_num(np.abs(moved) + 2.0 * sigma)
    most = float(reach.max(initial=0.0)) or 1.0
    first, last = float(years.min()), float(years.max())
    x = _LEFT + (years - first) / max(last - first, 1e-9) * (WIDTH - _LEFT - _RIGHT)
    middle = (_TOP + HEIGHT - _BOTTOM) / 2.0
    per = (HEIGHT - _BOTTOM - _TOP) / 2.0 / most
    parts = [
        f'<line class="zero" x1="{_LEFT}" y1="{middle:.1f}" x2="{WIDTH - _RIGHT}" y2="{middle:.1f}"/>',
        f'<text class="title" x="{_LEFT}" y="14">{escape(name)}</text>',
        *(
            f'<text x="{_LEFT - 5}" y="{middle - sign * most * per + 4:.1f}" text-anchor="end">'
            f"{'−' if sign < 0 else ''}{most if sign else 0:.2g}</text>"
            for sign in (1, 0, -1)
        ),
        f'<text x="{_LEFT}" y="{HEIGHT - 6}">{first:.1f}</text>',
        f'<text x="{WIDTH - _RIGHT}" y="{HEIGHT - 6}" text-anchor="end">{last:.1f}</text>',
    ]
    for k, axis in enumerate(_AXES):
        if not (sigma[:, k] > 0.0).any():
            continue
        y = middle - moved[:, k] * per
        points = " ".join(f"{a:.1f},{b:.1f}" for a, b in zip(x, y, strict=True))
        parts.append(f'<polyline class="{axis}" points="{points}"/>')
        parts += [
            f'<line class="{axis}" x1="{a + k - 1:.1f}" x2="{a + k - 1:.1f}" y1="{b - s:.1f}" y2="{b + s:.1f}"/>'
            f'<path class="{axis}" transform="translate({a + k - 1:.1f} {b:.1f})" d="{_MARKS[k]}"/>'
            for a, b, s in zip(x, y, 2.0 * sigma[:, k] * per, strict=True)
        ]
    shown = WIDTH - _RIGHT
    for k, axis in reversed(list(enumerate(_AXES))):
        parts.append(f'<text class="{axis}" x="{shown}" y="14" text-anchor="end">{escape(labels[k])}</text>')
        parts.append(f'<path class="{axis}" transform="translate({shown - 13} 10.5)" d="{_MARKS[k]}"/>')
        shown -= 28
    about = escape(f"{name} [{unit}]")
    return Markup(
        f'<svg class="series" viewBox="0 0 {WIDTH} {HEIGHT}" role="img" aria-label="{about}">{"".join(parts)}</svg>'
    )


# ------------------------------------------------------------
# The comparison of two epochs as a page that needs nothing else.
# ------------------------------------------------------------


class Epoch(NamedTuple):
    """Summary and identity of an epoch as in ``results.json``, and its source."""

    place: str
    summary: dict[str, Any]
    identity: dict[str, Any]


def comparison_page(
    epochs: tuple[Epoch, Epoch],
    found: Moved,
    table: pl.DataFrame,
    verdict: list[str],
    known: bool,
    words: Words = ENGLISH,
) -> str:
    """Verdict, both epochs side by side, the drawing of movements, and the table, what has moved first.

    ``known``: tests are those with σ0 known.
    """
    rows = sorted(table.to_dicts(), key=lambda row: not row["moved"])
    title = epochs[1].summary["title"] or words("Two epochs")
    moved = int(table["moved"].sum())
    return (
        environment()
        .get_template("epochs.html.j2")
        .render(
            title=title,
            headline=words("{count:point has|points have} moved, of {all}", count=moved, all=table.height)
            if moved
            else words("Nothing has moved"),
            state="bad" if moved else "good",
            verdict=verdict,
            facts=_facts(epochs, words),
            rows=[_cells(row, DIGITS[found.unit], known, words) for row in rows],
            unit=found.unit,
            drawing=movement_drawing(found, words),
            identity=epochs[1].identity,
            say=words,
            style=Markup(asset("page.css") + asset("certificate.css") + asset("epochs.css")),
            running=running_heads(title, epochs[1].identity, words),
        )
    )


def _facts(epochs: tuple[Epoch, Epoch], words: Words) -> list[tuple[str, str, str]]:
    """Rows of what was compared: name, first epoch, second epoch."""

    def said(of: Epoch) -> dict[str, str]:
        data, sigma0 = of.summary, of.summary["sigma0"]
        test = data["global_test"]
        return {
            "results": of.place,
            "title": data["title"] or "–",
            "operator": of.identity.get("operator") or "–",
            "measured": of.identity.get("measured") or "–",
            "input as of": of.identity.get("date") or "–",
            "program": of.identity.get("program", "–"),
            "observations n": str(data["observations"]),
            "unknowns u": str(data["unknowns"]),
            "redundancy n − u + d": str(data["redundancy"]),
            "σ0 a posteriori / a priori": fixed(sigma0["ratio_of_sigmas"], 3),
            "global test": words("accepted") if test["accepted"] else words("rejected"),
        }

    first, second = map(said, epochs)
    return [(words(name), first[name], second[name]) for name in first]


def _cells(row: dict[str, Any], places: int, known: bool, words: Words) -> dict[str, Any]:
    p, test = (row["p"], row["test"]) if known else (row["p_estimated"], row["test_estimated"])
    return {
        "point": row["point"],
        "movement": [fixed(row[f"d{axis}"], places) for axis in "xyz"],
        "sigma": [fixed(row[f"sd{axis}"], places) for axis in "xyz"],
        "length": fixed(sum(row[f"d{axis}"] ** 2 for axis in "xyz") ** 0.5, places),
        "test": fixed(test, 2),
        "p": "< 0.0001" if p is not None and p < 1e-4 else fixed(p, 4),
        "moved": row["moved"],
        "said": words("moved") if row["moved"] else "",
    }


# ------------------------------------------------------------
# Content of the page of two epochs, from their adjustments.
# ------------------------------------------------------------


def epoch(place: Path, solved: Solved) -> Epoch:
    """An epoch, with the identity its results had; of a project, which has none yet, that of its file."""
    file = place / "results.json" if place.is_dir() else place
    identity = identity_of(solved.network.project, Identity())
    if file.name == "results.json" and file.is_file():
        note_input(file)
        identity |= json.loads(file.read_text(encoding="utf-8")).get("identity", {})
    return Epoch(str(place), summary(solved), identity)


def moved(first: Solved, found: Epochs, table: pl.DataFrame) -> Moved:
    """Places of the first epoch, movements and covariances, in project axes."""
    M = first.network.edge.matrix
    tests = found.result.points
    places = first.adjustment.values["point"][blocks_of(first.network, found.names)]
    drawn = drawn_axes(first.network.project.axes.xy)
    right = "xy".index(drawn["right"])
    backwards = [False, False, False]
    backwards[right], backwards[1 - right] = drawn["right_reversed"], drawn["up_reversed"]
    cofactors = np.array([test.cofactors for test in tests]).reshape(-1, 3, 3)
    return Moved(
        names=found.names,
        places=places @ M,
        movements=np.array([test.movement @ M for test in tests]).reshape(-1, 3),
        covariances=found.result.variance * (M.T @ cofactors @ M),
        moved=table["moved"].to_numpy(),
        unit=first.network.project.units.length,
        reversed=(backwards[0], backwards[1], backwards[2]),
        right=right,
    )


# ------------------------------------------------------------
# Movements of points in one adjustment of several epochs, as a page that needs nothing else.
# ------------------------------------------------------------

MOST_SERIES = 60
"""Points whose movements are drawn against time, the most significant ones."""
MOST_ROWS = 300


def movements_page(solved: Solved, of: Identity, words: Words) -> str:
    """Verdict, drawing of the movements from the first to the last epoch, curves against time, tables."""
    identity = identity_of(solved.network.project, of)
    title = solved.network.project.title or words("Movements of points")
    frame, project = movement_rows(solved), solved.network.project
    last = frame.group_by("point", maintain_order=True).last()
    moved = int(last["moved"].sum()) if last.height else 0
    return (
        environment()
        .get_template("movements.html.j2")
        .render(
            title=title,
            headline=words("{count:point has|points have} moved, of {all}", count=moved, all=last.height)
            if moved
            else words("Nothing has moved"),
            state="bad" if moved else "good",
            statements=statements(solved, words),
            drawing=movement_drawing(
                moved_points(point_table(solved), last, project.axes.xy, project.units.length), words
            )
            if last.height
            else "",
            series=_series(solved, last),
            shown=MOST_SERIES,
            parameters=listed_parameters(solved, words, MOST_ROWS),
            movements=listed_movements(frame, project.units.length, words, MOST_ROWS),
            say=words,
            style=Markup(asset("page.css") + asset("certificate.css") + asset("epochs.css")),
            running=running_heads(title, identity, words),
        )
    )


def moved_points(points: pl.DataFrame, last: pl.DataFrame, xy: str, unit: str) -> Moved:
    """Movements of points to their last epoch, ``last``, at the places of the table of points; ``xy``: the axes."""
    placed = last.join(
        points.select(pl.col("id").cast(pl.String), *(pl.col(a).alias(f"at_{a}") for a in "xyz")),
        left_on="point",
        right_on="id",
        maintain_order="left",
    )
    drawn = drawn_axes(xy)
    backwards = {drawn["right"]: drawn["right_reversed"], drawn["up"]: drawn["up_reversed"]}
    return Moved(
        names=tuple(placed["point"]),
        places=placed.select("at_x", "at_y", "at_z").to_numpy(),
        movements=placed.select("x", "y", "z").to_numpy(),
        covariances=covariances(placed),
        moved=placed["moved"].to_numpy(),
        unit=unit,
        reversed=(backwards["x"], backwards["y"], False),
        right="xy".index(drawn["right"]),
    )


def _series(solved: Solved, last: pl.DataFrame) -> list[Any]:
    """Curves against time, the most significant points first."""
    frame = movement_rows(solved)
    year = dict(zip(solved.network.motion.labels, solved.network.motion.times, strict=True))
    sizes = [float(frame[name].abs().max() or 0.0) for name in "xyz"] if frame.height else [0.0]  # type: ignore[arg-type]
    unit, factor = small_unit(solved.network.project.units.length, max(sizes) or 1.0)
    drawings = []
    for name in last.sort("p", nulls_last=True)["point"].head(MOST_SERIES):
        own = frame.filter(pl.col("point") == name)
        years = np.array([year[own["from"][0]], *(year[label] for label in own["to"])])
        values, sigma = (
            np.vstack([np.zeros(3), own.select(*(f"{s}{axis}" for axis in "xyz")).to_numpy()]) * factor
            for s in ("", "s")
        )
        drawings.append(series_drawing(f"{name} [{unit}]", years, values, sigma, unit, ("X", "Y", "Z")))
    return drawings
