"""The page: verdict, network, images, cameras, tests, tables, in one file that needs nothing else."""

from __future__ import annotations

from importlib.resources import files
from pathlib import Path
from typing import Any

from jinja2 import Environment, PackageLoader, StrictUndefined
from markupsafe import Markup
from scipy.special import ndtr

from mor.parameters.kinds import INTERIORS
from mor.report.html.derived import checked_coordinates, control_table, deviations
from mor.report.html.figures.camera import camera_figures
from mor.report.html.figures.layout import small_unit
from mor.report.html.figures.overlap import overlap, overlap_map
from mor.report.html.figures.tests import test_figures
from mor.report.html.library import chart_library
from mor.report.html.page_data import PageData, page_data
from mor.report.html.paper import running_heads
from mor.report.html.payload import MOST_ROWS, MOST_VECTORS, payload
from mor.report.html.provenance import listed_notes
from mor.report.html.verdict import headline, statements
from mor.report.layout import DIGITS
from mor.report.text.identity import persons
from mor.report.view import View
from mor.report.words.language import ENGLISH, Words

SCRIPTS = (
    "data.js",
    "theme.js",
    "table.js",
    "sketch.js",
    "network.js",
    "labels.js",
    "overlays.js",
    "images.js",
    "multiples.js",
    "overlap.js",
    "main.js",
)
MOST_LISTED = 200
"""Rows of the tables that are written out (control points)."""
MEANINGS = {
    **dict.fromkeys(("c", "fx", "fy", "f"), "camera constant"),
    **dict.fromkeys(("xh", "yh", "cx", "cy"), "principal point"),
    **dict.fromkeys(("A", "K", "k", "omega"), "radial distortion"),
    **dict.fromkeys(("B", "P", "p"), "tangential distortion"),
    **dict.fromkeys(("s", "sx", "sy"), "thin prism distortion"),
    **dict.fromkeys(("C", "b", "alpha"), "affinity"),
}
"""What the components of the interior orientations are, by their names without numbers."""
OF_PANORAMA = {
    "rate": "rate of rotation",
    **dict.fromkeys(("ahead", "aside"), "eccentricity of the projection centre"),
    **dict.fromkeys(("lean", "pitch"), "tilt of the line"),
    "A": "distortion along the line",
    **dict.fromkeys(("a", "b"), "uneven rotation"),
}
"""The same of panoramas, where it differs."""


def meaning(model: str, name: str) -> str:
    """Return the meaning of a component of an interior orientation, or an empty text."""
    known = {**MEANINGS, **OF_PANORAMA} if model == "panorama" else MEANINGS
    return known.get(name.rstrip("0123456789"), known.get(name, ""))


def page(view: View, words: Words = ENGLISH) -> str:
    """The page of an adjustment, in a language.

    Raises :class:`mor.errors.InputError` where the chart library is missing.
    """
    data = page_data(view, words)
    cameras = camera_figures(data)
    figures: dict[str, Any] = dict(test_figures(data))
    for number, charts in enumerate(cameras):
        figures |= {f"camera{number}_{name}": chart for name, chart in charts.items()}
    covered = overlap_map(overlap(view, data.rays))
    template = environment().get_template("page.html.j2")
    return template.render(
        **_content(data),
        figures=figures,
        overlap=covered is not None,
        payload=Markup(payload(data, figures, covered)),
        library=Markup(chart_library()),
        style=Markup(asset("page.css")),
        running=running_heads(
            data.view.summary["title"] or data.words("Adjustment"), data.view.identity, data.words
        ),
        scripts=[Markup(asset(name)) for name in SCRIPTS],
    )


def environment() -> Environment:
    """Return the template environment with its filters."""
    environment = Environment(
        loader=PackageLoader("mor.report.html"),
        autoescape=True,
        undefined=StrictUndefined,
        trim_blocks=True,
        lstrip_blocks=True,
    )
    environment.filters |= {
        "short": _short,
        "fixed": _fixed,
        "probability": _probability,
        "coordinate": _coordinate,
    }
    return environment


def asset(name: str) -> str:
    """Text of a style sheet or script."""
    return files("mor.report.html").joinpath("assets", name).read_text(encoding="utf-8")


def _content(data: PageData) -> dict[str, Any]:
    view = data.view
    control = control_table(view)
    return {
        "title": view.summary["title"] or data.words("Adjustment"),
        "summary": view.summary,
        "identity": view.identity,
        **listed_notes(view.notes, data.words),
        "persons": persons(view.identity, data.words),
        "headline": headline(data),
        "statements": statements(data),
        "cameras": [_camera(camera) for camera in view.cameras],
        "groups": view.groups.to_dicts(),
        "gross": view.gross_errors,
        "relative": view.relative,
        "checks": view.checks,
        "deviations": [
            (kind, rows)
            for kind, rows in (
                ("control points", deviations(control)),
                ("check points", deviations(checked_coordinates(view))),
            )
            if rows
        ],
        "control": control[:MOST_LISTED].to_dicts(),
        "control_left": max(0, control.height - MOST_LISTED),
        "counts": {
            "points": data.points.height,
            "images": data.images.height,
            "stations": view.stations.height,
            "residuals": view.residuals.height,
            "vectors": data.measured.height,
        },
        "limits": {"rows": MOST_ROWS, "vectors": MOST_VECTORS},
        "critical": view.critical,
        "snooping_level": view.summary["snooping_level"],
        "residuals_file": view.residuals_file,
        "points_file": f"points{Path(view.residuals_file).suffix}" if view.residuals_file else "",
        "angle_unit": data.angle_unit,
        "sigma_words": sigma_words(data),
        "datum": data.datum,
        "movements": [data.words(name) for name in view.summary["movements"]],
        "say": data.words,
        "language": data.words.language,
        **_movement(view),
    }


def _movement(view: View) -> dict[str, Any]:
    """Unit and factor in which movements of points are listed."""
    rows = view.gross_errors.get("suspicious", [])
    sizes = [abs(value) for row in rows for value in row["movement"] or ()]
    unit, factor = small_unit(view.length, max(sizes, default=1.0))
    return {"movement_unit": unit, "movement_factor": factor}


def sigma_words(data: PageData) -> str:
    """State which σ0 every σ of the page refers to."""
    sigma0 = data.view.summary["sigma0"]
    posterior = sigma0["used_for_sigma"] != sigma0["apriori"]
    return data.words(
        "σ: standard deviations (1σ) with σ0 {which} = {used}; datum: {datum}",
        which=data.words("a posteriori") if posterior else data.words("a priori"),
        used=f"{sigma0['used_for_sigma']:.4g}",
        datum=data.datum,
    )


def _camera(camera: dict[str, Any]) -> dict[str, Any]:
    quantities = {c.name: c.quantity for c in INTERIORS[camera["model"]].components}
    rows = []
    for name, component in camera["components"].items():
        t = abs(component["value"]) / component["sigma"] if component["sigma"] else None
        rows.append(
            {
                "name": name,
                "meaning": meaning(camera["model"], name),
                "unit": raised(quantities[name].unit("m", "rad", camera["unit"])),
                **component,
                "t": t,
                "p": float(2.0 * ndtr(-t)) if t is not None else None,
            }
        )
    return {**camera, "rows": rows}


def raised(unit: str) -> str:
    """A unit with its exponent raised: 1/mm² for 1/mm^2."""
    base, _, exponent = unit.partition("^")
    return base + exponent.translate(str.maketrans("0123456789", "⁰¹²³⁴⁵⁶⁷⁸⁹"))


def _short(value: float | None, digits: int = 4) -> str:
    return "–" if value is None else f"{value:.{digits}g}".replace("-", "−")


def _coordinate(value: float | None, unit: str) -> str:
    """A coordinate with the decimals of its unit."""
    return _fixed(value, DIGITS[unit]) if unit in DIGITS else _short(value, 9)


def _probability(value: float | None) -> str:
    return "–" if value is None else "< 0.0001" if value < 1e-4 else f"{value:.4f}"


def _fixed(value: float | None, digits: int) -> str:
    return "–" if value is None else f"{value:.{digits}f}".replace("-", "−")
