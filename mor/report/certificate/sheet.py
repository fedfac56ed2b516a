"""The certificate of a camera as a page and as text."""

from __future__ import annotations

from typing import Any

import numpy as np
from markupsafe import Markup

from mor.report.certificate.content import Certificate
from mor.report.certificate.drawing import curve_drawing
from mor.report.columns import WIDTH, paragraphs
from mor.report.html.page import asset, environment, meaning, raised
from mor.report.html.paper import running_heads
from mor.report.layout import digits_worth, fixed, heading, short, table
from mor.report.text.identity import LINE, persons
from mor.report.words.datum import datum_name
from mor.report.words.language import ENGLISH, Words


def certificate_page(one: Certificate, words: Words = ENGLISH) -> str:
    """One sheet of HTML that needs nothing else, no script either."""
    title = words("Calibration of camera {id}", id=one.camera["id"])
    return (
        environment()
        .get_template("certificate.html.j2")
        .render(
            title=title,
            facts=[*_facts(one, words), *_validity(one, words)],
            parameters=_parameters(one, words),
            correlations=one.camera["correlations"],
            distortion=_distortion(one),
            small=one.small[0],
            unit=one.unit,
            drawing=curve_drawing(one, words),
            identity=one.view.identity,
            say=words,
            style=Markup(asset("page.css") + asset("certificate.css")),
            running=running_heads(title, one.view.identity, words),
        )
    )


def certificate_text(one: Certificate, words: Words = ENGLISH) -> str:
    """Return the certificate as text, at most 100 characters wide."""
    title = words("Calibration of camera {id}", id=one.camera["id"])
    facts = [*_facts(one, words), *_validity(one, words)]
    width = max(len(name) for name, _ in facts)
    names, matrix = one.camera["correlations"]["components"], one.camera["correlations"]["matrix"]
    parts = [
        "\n".join(
            [title, "=" * min(len(title), WIDTH), *(f"{name.ljust(width)}  {text}" for name, text in facts)]
        ),
        "\n".join([heading(words("Parameters")), _parameter_table(one, words)]),
        "\n".join(
            [heading(words("Radial distortion, mean over all directions")), _distortion_table(one, words)]
        ),
    ]
    if matrix is not None and len(names) > 1:
        body = [[name, *(fixed(x, 3) for x in matrix[k][: k + 1])] for k, name in enumerate(names)]
        padded = [[*row, *[""] * (len(names) + 1 - len(row))] for row in body]
        parts.append(
            "\n".join([heading(words("Correlations [1]")), table(["", *names], padded, words=words)])
        )
    signed = f"{words('place and date').ljust(len(LINE))}    {words('signature')}"
    parts.append(f"\n{LINE}    {LINE}\n{signed}")
    return paragraphs("\n\n".join(parts)) + "\n"


def _facts(one: Certificate, words: Words) -> list[tuple[str, str]]:
    """Camera, client and adjustment."""
    view, camera = one.view, one.camera
    sigma0 = view.summary["sigma0"]
    test = view.summary["global_test"]
    judged = words("accepted") if test["accepted"] else words("rejected")
    return [
        (words("project"), view.summary["title"] or "–"),
        *persons(view.identity, words),
        (
            words("camera"),
            words("{id}, model {model}", id=camera["id"], model=camera["model"]) + _r0(one, words),
        ),
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
            words("{judged}; sigma0 a posteriori / a priori {ratio}", judged=judged, ratio=_ratio(sigma0)),
        ),
        (words("datum"), datum_name(view.summary["datum"], words)),
        (words("program"), view.identity["program"]),
    ]


def _ratio(sigma0: dict[str, Any]) -> str:
    return fixed(sigma0["ratio_of_sigmas"], 3)


def _r0(one: Certificate, words: Words) -> str:
    r0 = one.camera["r0"]
    return "" if r0 is None else f", r0 = {words.number(short(r0, 6))} {one.unit}"


def _format(camera: dict[str, Any], words: Words) -> str:
    size = camera.get("format")
    if size is None:
        return words("not given")
    pixel = (
        "" if camera["unit"] == "px" else f", {words.number(short(size['pixel'], 6))} {camera['unit']} / px"
    )
    return f"{size['width']:g} × {size['height']:g} px{pixel}"


def _validity(one: Certificate, words: Words) -> list[tuple[str, str]]:
    """Largest distance from the principal point at which measurements support the parameters."""
    said = words(
        "up to {radius} {unit} from the principal point", radius=short(one.covered, 4), unit=one.unit
    )
    if one.corner is None:
        return [(words("valid"), said)]
    said += words(
        "; the farthest corner is at {corner} {unit} ({share} % of it)",
        corner=short(one.corner, 4),
        unit=one.unit,
        share=f"{100.0 * min(one.covered / one.corner, 1.0):.0f}",
    )
    return [(words("valid"), said)]


def _parameters(one: Certificate, words: Words) -> list[dict[str, str]]:
    return [
        {
            "name": name,
            "meaning": words(meaning("", name)),
            "unit": raised(one.units[name]),
            "value": short(row["value"], digits_worth(row["value"], row["sigma"])),
            "sigma": short(row["sigma"], 3),
            "significance": fixed(row.get("t"), 1) if name != "c" else "-",
            "status": words.listed(row["status"]),
        }
        for name, row in one.camera["components"].items()
    ]


_COLUMNS = ("value", "sigma", "significance", "status")


def _parameter_table(one: Certificate, words: Words) -> str:
    rows = [
        [row["name"], row["meaning"], one.units[row["name"]], *(row[key] for key in _COLUMNS)]
        for row in _parameters(one, words)
    ]
    headers = ["component", "", "unit", "value", "sigma", "value/sigma", "status"]
    return table(headers, rows, 3, words)


def _distortion(one: Certificate) -> list[tuple[str, str, str, bool]]:
    """Radius, distortion, σ, and whether points were measured so far out."""
    factor, places = one.small[1], _decimals(one)
    rows = zip(one.table.radius, one.table.shift * factor, one.table.sigma * factor, strict=True)
    return [
        (short(r, 5), fixed(s + 0.0, places), fixed(e, places), bool(r <= one.covered)) for r, s, e in rows
    ]


def _decimals(one: Certificate) -> int:
    """Decimals of distortions: two figures of the largest σ; without σ three."""
    largest = float(one.table.sigma.max(initial=0.0)) * one.small[1]
    return 3 if largest == 0.0 else int(np.clip(1 - np.floor(np.log10(largest)), 0, 7))


def _distortion_table(one: Certificate, words: Words) -> str:
    rows = [[r, s, e, "" if inside else words("extrapolated")] for r, s, e, inside in _distortion(one)]
    small = one.small[0]
    headers = [f"radius [{one.unit}]", f"distortion [{small}]", f"sigma [{small}]", ""]
    return table(headers, rows, 0, words, last_left=True)
