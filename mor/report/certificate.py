"""The certificate of a camera."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np
import polars as pl
from markupsafe import Markup, escape

from mor.errors import InputError, Message, nearest
from mor.model.cameras import CAMERA_MODELS
from mor.model.parameters import INTERIORS
from mor.report.figures import BESIDE
from mor.report.language import Words, datum_name
from mor.report.layout import (
    aligned,
    correlation_table,
    coverage_words,
    digits_worth,
    fixed,
    heading,
    paragraphs,
    persons,
    round_length,
    short,
    signature,
    small_unit,
    table,
    titled,
)
from mor.report.movements import drawing
from mor.report.page import meaning, raised, rendered
from mor.report.page_data import image_points
from mor.report.view import RadialCurve, View, radial_curve
from mor.types import FloatArray
from mor.units import LENGTH_UNITS

if TYPE_CHECKING:
    from mor.report.paper import Writer

# ---- Content of a camera certificate as plain data.


class Certificate(NamedTuple):
    """A camera of an adjustment: its parameters, its distortion and what they rest on. Lengths in ``unit``."""

    view: View
    camera: dict[str, Any]
    units: dict[str, str]
    """Unit of each component."""
    images: int
    rays: int
    rms: float
    """Root mean square of the residuals of image coordinates."""
    covered: float
    """Distance from the principal point up to which points were measured."""
    corner: float | None
    """Distance of the farthest corner of the image from the principal point; ``None`` without a format."""
    curve: RadialCurve
    """Up to the corner, or what is covered."""
    table: RadialCurve
    """The same at round radii."""
    coverage: float | None = None
    """Factor k of expanded uncertainties; none without."""

    @property
    def unit(self) -> str:
        """Unit of the interior orientation."""
        return str(self.camera["unit"])

    @property
    def small(self) -> tuple[str, float]:
        """Unit and factor of distortions."""
        return small_unit(self.unit, float(np.abs(self.curve.shift).max(initial=0.0)))


def certificate(view: View, name: str, coverage: float | None = None) -> Certificate:
    """Return the certificate of a camera, with expanded uncertainties if a coverage factor is given.

    Raises :class:`InputError` for an unknown camera, or one without image points.
    """
    cameras = {camera["id"]: camera for camera in view.cameras}
    if name not in cameras:
        known = f" (known: {', '.join(cameras)})" if cameras else ""
        raise InputError([Message(f"unknown camera {name!r}{nearest(name, cameras)}{known}")])
    camera = cameras[name]
    if not CAMERA_MODELS[camera["model"]].central:
        words = (
            f"camera {name} is of the model {camera['model']}, whose images have no radial distortion; the report "
            "has its parameters"
        )
        raise InputError([Message(words)])
    images = view.images.filter(pl.col("camera") == name)
    measured = image_points(view).join(images.select(pl.col("id").alias("image")), on="image", how="semi")
    measured = measured.filter(~pl.col("flag").str.contains("excluded|check"))
    if not measured.height:
        raise InputError([Message(f"camera {name} has no image points: there is nothing to certify")])
    covered, corner = float(np.nanmax(_radii(camera, measured))), _corner(camera)
    largest = max(covered, corner or 0.0)
    residuals = measured.select("vx", "vy").to_numpy() * _per_unit(camera, str(measured["unit"][0]))
    quantities = {component.name: component.quantity for component in INTERIORS[camera["model"]].components}
    # Rows of the table of distortion, at most.
    most_rows = 12
    power = 10.0 ** np.floor(np.log10(largest / most_rows))
    step = power * next(factor for factor in (1.0, 2.0, 5.0, 10.0) if factor * power * most_rows >= largest)
    count = int(np.floor(largest / step * (1.0 + 1e-12)))
    return Certificate(
        view=view,
        camera=camera,
        units={
            key: quantities[key].unit(view.summary["units"]["length"], "rad", camera["unit"])
            for key in camera["components"]
        },
        images=images.height,
        rays=measured.height,
        rms=float(np.sqrt(np.nanmean(residuals**2))),
        covered=covered,
        corner=corner,
        curve=radial_curve(camera, largest),
        table=radial_curve(camera, count * step, count + 1),
        coverage=coverage,
    )


def _per_unit(camera: dict[str, Any], unit: str) -> float:
    if unit == camera["unit"]:
        return 1.0
    if unit == "px":
        return float(camera["format"]["pixel"])
    return LENGTH_UNITS[unit] / LENGTH_UNITS[camera["unit"]]


def _principal_point(camera: dict[str, Any]) -> FloatArray:
    """(2,) from where the camera counts it: the image centre, y up, or the corner, y down."""
    values = camera["components"]
    names = ("cx", "cy") if "cx" in values else ("xh", "yh")
    return np.array([values[name]["value"] if name in values else 0.0 for name in names])


def _radii(camera: dict[str, Any], measured: pl.DataFrame) -> FloatArray:
    xy = measured.select("x", "y").to_numpy() * _per_unit(camera, str(measured["unit"][0]))
    down = _is_corner(camera) and not _counts_from_corner(camera)
    return np.asarray(
        np.linalg.norm(xy - _origin(camera) - _principal_point(camera) * np.array([1.0, -1.0 if down else 1.0]), axis=1)
    )


def _is_corner(camera: dict[str, Any]) -> bool:
    size = camera.get("format")
    return size is not None and size["origin"] == "corner"


def _counts_from_corner(camera: dict[str, Any]) -> bool:
    return _is_corner(camera) and "cx" in camera["components"]


def _origin(camera: dict[str, Any]) -> FloatArray:
    if not _is_corner(camera) or _counts_from_corner(camera):
        return np.zeros(2)
    size = camera["format"]
    return np.asarray(np.array([size["width"], size["height"]]) * size["pixel"] / 2.0)


def _corner(camera: dict[str, Any]) -> float | None:
    size = camera.get("format")
    if size is None:
        return None
    half = np.array([size["width"], size["height"]]) * size["pixel"] / 2.0
    centre = _principal_point(camera) - (half if _counts_from_corner(camera) else 0.0)
    return float(np.hypot(*(half + np.abs(centre))))


# ---- The curve of radial distortion as a small drawing (SVG) that prints without any script, also in black and white.

WIDTH, HEIGHT = 460, 230
_LEFT, _RIGHT, _TOP, _BOTTOM = 58, 12, 24, 40


def curve_drawing(one: Certificate, words: Words) -> Markup:
    """Radial distortion by radius with its 95 % band, and where the points end that it rests on."""
    unit, factor = one.small
    radius, shift = one.curve.radius, one.curve.shift * factor
    beside = BESIDE * one.curve.sigma * factor
    low, high = float((shift - beside).min()), float((shift + beside).max())
    low, high = (low, high) if high > low else (low - 1.0, high + 1.0)
    x = _LEFT + (WIDTH - _LEFT - _RIGHT) * radius / radius[-1]
    scale = (HEIGHT - _TOP - _BOTTOM) / (high - low)

    def level(values: FloatArray) -> FloatArray:
        return np.asarray(HEIGHT - _BOTTOM - scale * (values - low))

    band = [*zip(x, level(shift + beside), strict=True), *zip(x[::-1], level((shift - beside)[::-1]), strict=True)]
    end = _LEFT + (WIDTH - _LEFT - _RIGHT) * min(one.covered / float(radius[-1]), 1.0)
    parts = [
        *_levels(low, high, level, words),
        *_drawn_radii(float(radius[-1]), words),
        f'<polygon class="band" points="{_points(band)}"/>',
        f'<polyline class="curve" points="{_points(list(zip(x, level(shift), strict=True)))}"/>',
        f'<line class="covered" x1="{end:.1f}" y1="{_TOP}" x2="{end:.1f}" y2="{HEIGHT - _BOTTOM}"/>',
        _text(WIDTH - _RIGHT, HEIGHT - 6, words("distance from the principal point [{unit}]", unit=one.unit), "end"),
        _text(_LEFT - 30, _TOP - 10, words("distortion [{unit}]", unit=unit), "start"),
    ]
    return drawing(parts, WIDTH, HEIGHT, words("Radial distortion, mean over all directions"))


def _levels(low: float, high: float, level: object, words: Words) -> list[str]:
    step = round_length((high - low) / 3.0)
    values = np.arange(np.ceil(low / step), np.floor(high / step) + 0.5) * step
    lines = []
    for value, y in zip(values.tolist(), level(values).tolist(), strict=True):  # type: ignore[operator]
        lines.append(f'<line class="grid" x1="{_LEFT}" y1="{y:.1f}" x2="{WIDTH - _RIGHT}" y2="{y:.1f}"/>')
        lines.append(_text(_LEFT - 5, y + 4, words.number(f"{value + 0.0:g}").replace("-", "−"), "end"))
    return lines


def _drawn_radii(largest: float, words: Words) -> list[str]:
    step = round_length(largest / 4.0)
    lines = []
    for value in (np.arange(0.0, np.floor(largest / step) + 0.5) * step).tolist():
        x = _LEFT + (WIDTH - _LEFT - _RIGHT) * value / largest
        lines.append(f'<line class="grid" x1="{x:.1f}" y1="{_TOP}" x2="{x:.1f}" y2="{HEIGHT - _BOTTOM}"/>')
        lines.append(_text(x, HEIGHT - _BOTTOM + 15, words.number(f"{value:g}"), "middle"))
    return lines


def _text(x: float, y: float, said: str, anchor: str) -> str:
    return f'<text x="{x:.1f}" y="{y:.1f}" text-anchor="{anchor}">{escape(said)}</text>'


def _points(pairs: list[tuple[float, float]]) -> str:
    return " ".join(f"{x:.1f},{y:.1f}" for x, y in pairs)


# ---- The certificate of a camera as a page and as text.


def certificate_page(one: Certificate, words: Words) -> str:
    """One sheet of HTML that needs nothing else, no script either."""
    title = words("Calibration of camera {id}", id=one.camera["id"])
    return rendered(
        "certificate.html.j2",
        title,
        one.view.identity,
        words,
        ("page.css", "certificate.css"),
        facts=[*_facts(one, words), *_validity(one, words)],
        parameters=_parameters(one, words),
        correlations=one.camera["correlations"],
        distortion=_distortion(one),
        expanded=_expanded(one),
        small=one.small[0],
        unit=one.unit,
        drawing=curve_drawing(one, words),
    )


def certificate_text(one: Certificate, words: Words) -> str:
    """Return the certificate as text, at most 100 characters wide."""
    title = words("Calibration of camera {id}", id=one.camera["id"])
    facts = [*_facts(one, words), *_validity(one, words)]
    names, matrix = one.camera["correlations"]["components"], one.camera["correlations"]["matrix"]
    rows = [[*cells, "" if inside else words("extrapolated")] for cells, inside in _distortion(one)]
    small = one.small[0]
    headers = [f"radius [{one.unit}]", f"distortion [{small}]", f"sigma [{small}]", *_expanded(one, f" [{small}]"), ""]
    columns = ["value", "sigma", *_expanded(one), "significance", "status"]
    parameters = [
        [row["name"], row["meaning"], one.units[row["name"]], *(row[key] for key in columns)]
        for row in _parameters(one, words)
    ]
    of_parameters = ["component", "", "unit", "value", "sigma", *_expanded(one), "value/sigma", "status"]
    lines = [*titled(title), *aligned(facts)]
    lines += ["", heading(words("Parameters")), table(of_parameters, parameters, 3, words)]
    lines += ["", heading(words("Radial distortion, mean over all directions"))]
    lines.append(table(headers, rows, 0, words, last_left=True))
    if matrix is not None and len(names) > 1:
        lines += ["", heading(words("Correlations [1]")), correlation_table(names, matrix, words)]
    return paragraphs("\n".join([*lines, "", *signature(words)])) + "\n"


def certificate_on_paper(one: Certificate, paper: str, words: Words) -> Writer:
    """Return the certificate on sheets of paper. Raises :class:`InputError` if reportlab or Matplotlib is missing."""
    from mor.report.paper import Writer
    from mor.report.plots import draw_correlations, draw_curve, sheet, style

    to = Writer(words("Calibration of camera {id}", id=one.camera["id"]), paper, words, one.view.identity["program"])
    to.heading(words("Calibration of camera {id}", id=one.camera["id"]), 1)
    to.facts([*_facts(one, words), *_validity(one, words)])
    keys = ("name", "meaning", "unit", "status", "value", "sigma", *_expanded(one), "significance")
    headers = (*map(words, ("name", "meaning", "unit", "status", "value")), "σ", *_expanded(one), words("value/σ"))
    to.heading(words("Parameters"))
    to.table(headers, [[row[key] for key in keys] for row in _parameters(one, words)], 4)
    to.heading(words("Radial distortion, mean over all directions"))
    with style():
        figure = sheet(9.0, 2.9)
        left, right = figure.subplots(1, 2)
        draw_curve(left, one.camera, one.curve, words)
        left.axvline(one.covered, color="black", ls="--", lw=0.8)
        draw_correlations(right, one.camera, words)
        to.picture(figure)
    to.note(words("Dashed: the outermost measured point."))
    small = one.small[0]
    headers = (words("radius [{unit}]", unit=one.unit), words("distortion [{unit}]", unit=small), f"σ [{small}]")
    rows = [["" if inside else words("extrapolated"), *numbers] for numbers, inside in _distortion(one)]
    to.table(("", *headers, *_expanded(one, f" [{small}]")), rows)
    to.signature()
    return to


def _facts(one: Certificate, words: Words) -> list[tuple[str, str]]:
    view, camera = one.view, one.camera
    sigma0 = view.summary["sigma0"]
    judged = words("accepted") if view.summary["global_test"]["accepted"] else words("rejected")
    return [
        (words("project"), view.summary["title"] or "–"),
        *persons(view.identity, words),
        (words("camera"), words("{id}, model {model}", id=camera["id"], model=camera["model"]) + _r0(one, words)),
        (words("image format"), _format(camera, words)),
        (
            words("observations"),
            words(
                "{images:image|images}, {rays:image point|image points}, rms v {rms} {unit}",
                images=one.images,
                rays=one.rays,
                rms=short(one.rms * one.small[1], 3),
                unit=one.small[0],
            ),
        ),
        (
            words("global test"),
            words(
                "{judged}; sigma0 a posteriori / a priori {ratio}",
                judged=judged,
                ratio=fixed(sigma0["ratio_of_sigmas"], 3),
            ),
        ),
        (words("datum"), datum_name(view.summary["datum"], words)),
        (words("program"), view.identity["program"]),
    ]


def _r0(one: Certificate, words: Words) -> str:
    r0 = one.camera["r0"]
    return "" if r0 is None else f", r0 = {words.number(short(r0, 6))} {one.unit}"


def _format(camera: dict[str, Any], words: Words) -> str:
    size = camera.get("format")
    if size is None:
        return words("not given")
    pixel = "" if camera["unit"] == "px" else f", {words.number(short(size['pixel'], 6))} {camera['unit']} / px"
    return f"{size['width']:g} × {size['height']:g} px{pixel}"


def freedom(summary: dict[str, Any]) -> float:
    """Degrees of freedom of the σ0 that standard deviations refer to; infinite a priori."""
    sigma0 = summary["sigma0"]
    return float(summary["redundancy"]) if sigma0["used_for_sigma"] != sigma0["apriori"] else np.inf


def _validity(one: Certificate, words: Words) -> list[tuple[str, str]]:
    said = words("up to {radius} {unit} from the principal point", radius=short(one.covered, 4), unit=one.unit)
    if one.corner is not None:
        share = f"{100.0 * min(one.covered / one.corner, 1.0):.0f}"
        corner = "; the farthest corner is at {corner} {unit} ({share} % of it)"
        said += words(corner, corner=short(one.corner, 4), unit=one.unit, share=share)
    rows = [(words("valid"), said)]
    if one.coverage is not None:
        said = coverage_words(one.coverage, freedom(one.view.summary), words)
        rows.append((words("expanded uncertainty"), said))
    return rows


def _parameters(one: Certificate, words: Words) -> list[dict[str, str]]:
    return [
        {
            "name": name,
            "meaning": words(meaning("", name)),
            "unit": raised(one.units[name]),
            "value": short(row["value"], digits_worth(row["value"], row["sigma"])),
            "sigma": short(row["sigma"], 3),
            "U": short(None if row["sigma"] is None or one.coverage is None else row["sigma"] * one.coverage, 3),
            "significance": fixed(row.get("t"), 1) if name != "c" else "-",
            "status": words.listed(row["status"]),
        }
        for name, row in one.camera["components"].items()
    ]


def _expanded(one: Certificate, unit: str = "") -> list[str]:
    return [f"U{unit}"] if one.coverage is not None else []


def _distortion(one: Certificate) -> list[tuple[list[str], bool]]:
    """Radius, distortion, σ and U, and whether points were measured so far out."""
    largest = float(one.table.sigma.max(initial=0.0)) * one.small[1]
    factor, places = one.small[1], (3 if largest == 0.0 else int(np.clip(1 - np.floor(np.log10(largest)), 0, 7)))
    rows = zip(one.table.radius, one.table.shift * factor, one.table.sigma * factor, strict=True)
    beside = [1.0] if one.coverage is None else [1.0, one.coverage]
    return [
        ([short(r, 5), fixed(s + 0.0, places), *(fixed(k * e, places) for k in beside)], bool(r <= one.covered))
        for r, s, e in rows
    ]
