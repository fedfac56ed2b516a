"""The verdict in plain words: statements, each with its numbers, good, doubtful or bad."""

from __future__ import annotations

import re
from typing import Any, NamedTuple

import numpy as np
import polars as pl

from mor.report.html.derived import rms
from mor.report.html.page_data import PageData

GOOD, DOUBT, BAD, PLAIN = "good", "doubt", "bad", "plain"
_NARROW = {"gon": 10.0, "deg": 9.0}
_LOW_R = 0.1
_STRONG = 0.95
_NEGATIVE = re.compile(r"(?<![\w-])-(?=\d)|(?<=e)-(?=\d)")
"""Hyphens that are minus signs."""


class Statement(NamedTuple):
    """What to think of one thing, and the numbers it rests on."""

    state: str
    title: str
    words: str


def statements(data: PageData) -> list[Statement]:
    """The statements, the most important first."""
    parts = [_global(data), _worst(data), _controlled(data), _checks(data), _points(data), _geometry(data)]
    found = [statement for statement in [*parts, *_cameras(data)] if statement is not None]
    return [statement._replace(words=_NEGATIVE.sub("−", statement.words)) for statement in found]


def headline(data: PageData) -> Statement:
    """One sentence: accepted or not."""
    summary = data.view.summary
    test = summary["global_test"]
    count = f"converged after {summary['iterations']} iterations"
    if summary["redundancy"] == 0:
        return Statement(
            BAD, "Not controlled", f"The adjustment {count}, but the redundancy is 0: nothing is tested."
        )
    if not test["accepted"]:
        larger = test["statistic"] > test["upper"]
        words = "larger than" if larger else "smaller than"
        return Statement(
            BAD if larger else DOUBT,
            "Not accepted",
            f"The adjustment {count}, but the global test rejects it: residuals are {words} the σ given a priori say "
            f"(σ0 a posteriori / a priori = {summary['sigma0']['ratio_of_sigmas']:.3f}); "
            f"{_counted(summary['flagged'])} flagged.",
        )
    if summary["flagged"]:
        return Statement(
            DOUBT,
            "Accepted, with observations to look at",
            f"The adjustment {count}, the global test accepts it; {_counted(summary['flagged'])} flagged.",
        )
    return Statement(
        GOOD, "Accepted", f"The adjustment {count}, the global test accepts it, nothing is flagged."
    )


def _counted(count: int) -> str:
    if count == 0:
        return "no observation is"
    return "1 observation is" if count == 1 else f"{count} observations are"


def _global(data: PageData) -> Statement | None:
    summary = data.view.summary
    test, sigma0 = summary["global_test"], summary["sigma0"]
    if summary["redundancy"] == 0:
        return None
    numbers = (
        f"vᵀPv = {test['statistic']:.1f} with {summary['redundancy']} degrees of freedom, accepted between "
        f"{test['lower']:.1f} and {test['upper']:.1f} (χ², level {test['level']:g}); "
        f"σ0 a posteriori / a priori = {sigma0['ratio_of_sigmas']:.3f}."
    )
    if test["accepted"]:
        return Statement(GOOD, "Global test", f"Residuals agree with the σ given a priori: {numbers}")
    larger = test["statistic"] > test["upper"]
    advice = (
        "Residuals are larger than the σ given a priori say: look for gross errors first, then for a model that "
        "lacks something, then enlarge the σ of the groups that need it."
        if larger
        else "Residuals are smaller than the σ given a priori say: the observations are better than was assumed."
    )
    return Statement(BAD if larger else DOUBT, "Global test", f"{advice} {numbers}")


def _worst(data: PageData) -> Statement | None:
    used = data.view.used.filter(pl.col("test").is_not_null())
    if used.height == 0:
        return None
    row = used[int(used["test"].abs().arg_max() or 0)].row(0, named=True)
    summary = data.view.summary
    expected = used.height * summary["snooping_level"]
    sentence = (
        f"{_counted(summary['flagged']).capitalize()} beyond |w| = {data.view.critical:.2f} (chance alone would make "
        f"about {expected:.1f} of {used.height}). The worst is {place(row)}: w = {row['test']:.2f}, estimated error "
        f"{row['error']:.3g} {row['unit']}."
    )
    many = summary["flagged"] > expected + 3.0 * np.sqrt(max(expected, 1.0))
    state = GOOD if not summary["flagged"] else BAD if many else DOUBT
    return Statement(state, "Single observations", sentence)


def place(row: dict[str, Any]) -> str:
    """An observation in words: type, between what, component."""
    between = " – ".join(part for part in (row["at"], row["from"], row["to"]) if part)
    return f"{row['type']} {between}, {row['component']}"


def _controlled(data: PageData) -> Statement | None:
    used = data.view.used.filter(pl.col("r").is_not_null())
    if used.height == 0:
        return None
    low = used.filter(pl.col("r") < _LOW_R).height
    loose = data.view.summary["uncontrolled"]
    mean = float(used["r"].to_numpy().mean())
    words = f"Mean redundancy number {mean:.2f}; {low} of {used.height} observations have r < {_LOW_R:g}"
    words += f", {loose} of them no control at all (an error there stays unseen)." if loose else "."
    state = DOUBT if low > 0.05 * used.height or loose else GOOD
    return Statement(state, "Reliability", words)


def _checks(data: PageData) -> Statement | None:
    checks = data.view.checks
    if not checks:
        return None
    worst = max(checks, key=lambda row: abs(row["largest"]))
    beyond = int(sum(row["exceeding"] for row in checks))
    parts = "; ".join(
        f"{row['group']} {row['component']}: rms {row['rms']:.3g} {row['unit']} ({int(row['count'])})"
        for row in checks
    )
    words = f"{parts}. Largest deviation {worst['largest']:.3g} {worst['unit']}; {beyond} beyond their test."
    return Statement(DOUBT if beyond else GOOD, "Checks kept out", words)


def _points(data: PageData) -> Statement | None:
    points = data.points.filter(pl.col("status") != "fixed")
    if points.height == 0:
        return None
    sigma = [rms(points[f"s{name}"].cast(pl.Float64).fill_null(np.nan).to_numpy()) for name in "xyz"]
    numbers = ", ".join(
        f"σ{name.upper()} {value:.3g}" for name, value in zip("xyz", sigma, strict=True) if value is not None
    )
    worst = points.sort("ellipsoid_a", descending=True, nulls_last=True, maintain_order=True).row(
        0, named=True
    )
    unit = data.view.length
    words = f"Root mean square {numbers} {unit}; the weakest point is {worst['id']}"
    words += (
        f" (longest semi-axis of its ellipsoid {worst['ellipsoid_a']:.3g} {unit})."
        if worst["ellipsoid_a"]
        else "."
    )
    return Statement(PLAIN, "Points", f"{words} Datum: {data.view.summary['datum']}.")


def _geometry(data: PageData) -> Statement | None:
    if not len(data.rays.frame):
        return None
    rays = np.bincount(data.rays.point, minlength=data.points.height)
    only = data.points.with_columns(pl.Series("n", rays)).filter(pl.col("others") == 0)
    two = only.filter(pl.col("n") <= 2).height
    narrow = only.filter(pl.col("angle") < _NARROW[data.angle_unit]).height
    words = (
        f"{two} points are seen by two rays only, {narrow} under less than "
        f"{_NARROW[data.angle_unit]:g} {data.angle_unit} (points that nothing but rays determine)."
    )
    return Statement(DOUBT if two or narrow else GOOD, "Rays", words)


def _cameras(data: PageData) -> list[Statement]:
    return [_camera(camera) for camera in data.view.cameras]


def _camera(camera: dict[str, Any]) -> Statement:
    first, component = next(iter(camera["components"].items()))
    value = f"{first} = {component['value']:.6g}"
    value += (
        f" ± {component['sigma']:.2g} {camera['unit']}"
        if component["sigma"]
        else f" {camera['unit']} (fixed)"
    )
    names, matrix = camera["correlations"]["components"], camera["correlations"]["matrix"]
    weak = [name for name, c in camera["components"].items() if _insignificant(name, c)]
    words = f"{value}."
    strong = _strongest(names, matrix)
    if strong is not None:
        words += f" Largest correlation {strong[2]:.2f} between {strong[0]} and {strong[1]}."
    words += f" Not significant: {', '.join(weak)}." if weak else ""
    doubt = weak or (strong is not None and abs(strong[2]) > _STRONG)
    return Statement(DOUBT if doubt else GOOD, f"Camera {camera['id']}", words)


def _insignificant(name: str, component: dict[str, Any]) -> bool:
    return name not in ("c", "fx", "fy", "xh", "yh", "cx", "cy") and bool(
        component["sigma"] and abs(component["value"]) < 1.96 * component["sigma"]
    )


def _strongest(names: list[str], matrix: list[list[float]] | None) -> tuple[str, str, float] | None:
    if matrix is None or len(names) < 2:
        return None
    lower = np.tril(np.array(matrix), -1)
    i, j = np.unravel_index(int(np.argmax(np.abs(lower))), lower.shape)
    return names[j], names[i], float(lower[i, j])
