"""Relative orientation of a chain of images for reading."""

from __future__ import annotations

from typing import Any

from mor.report.layout import fixed, heading, short, table
from mor.report.words.language import ENGLISH, Words

SHOWN = 6
"""Decimals of angles; of the ik and the base one more."""


def relative_text(data: dict[str, Any], words: Words = ENGLISH) -> str:
    """Every pair, then the model of all images."""
    parts = [_pair(pair, len(data["pairs"]) > 1, words) for pair in data["pairs"]]
    parts.append(_model(data, words))
    return "\n\n".join(part for part in parts if part) + "\n"


def _pair(pair: dict[str, Any], many: bool, words: Words) -> str:
    first, second = pair["images"]
    title = [heading(words("Images {first} and {second}", first=first, second=second))] if many else []
    lines = [*title, words("Relative orientation: {words}", words=_outcome(pair, words))]
    lines.append(words("object: {geometry}", geometry=words.listed(pair["geometry"])))
    lines.append(
        words(
            "{used} of {points} points used, sigma0 {sigma0} [1]",
            used=pair["used"],
            points=pair["points"],
            sigma0=short(pair["sigma0"], 4),
        )
    )
    if 10 * pair["used"] < 9 * pair["points"] and pair["usable"]:
        lines.append(
            words(
                "{count:point does|points do} not agree: more than a few wrong pairs can be a wrong camera constant, "
                "image coordinates not relative to the principal point, or mismatched identities.",
                count=pair["points"] - pair["used"],
            )
        )
    lines += _planes(pair, words)
    if pair["usable"]:
        lines += ["", _parameters(pair, words), _convention(words), "", _correlations(pair, words)]
        lines += ["", *_rinner(pair, words), "", _residuals(pair, words)]
    elif pair["angles"]["omega"] is not None:
        lines += ["", _parameters(pair, words)]
    if pair["alternatives"]:
        lines.append(
            words(
                "{count:other orientation fits|other orientations fit} about as well; a further image decides.",
                count=len(pair["alternatives"]),
            )
        )
    return "\n".join(lines)


def _outcome(pair: dict[str, Any], words: Words) -> str:
    said = words.listed(pair["words"].split(" (")[0])
    return f"{said} ({words.listed(pair['geometry'])})" if " (" in pair["words"] else said


def _planes(pair: dict[str, Any], words: Words) -> list[str]:
    """Both orientations of a plane, and how many points lie behind a camera."""
    lines = []
    for number, one in enumerate(pair["plane_orientations"], start=1):
        lines.append(
            words(
                "orientation {number} of the plane: base {base}; points behind a camera: {behind} of {points}",
                number=number,
                base=" ".join(words.number(fixed(value, 4)) for value in one["base"]),
                behind=one["behind"],
                points=one["behind"] + one["in_front_of_both"],
            )
        )
    return lines


def _convention(words: Words) -> str:
    return words("X_B* = D* (X_A* - b*), |b*| = 1, D* = (Rx(omega*) Ry(phi*) Rz(kappa*))^T")


def _parameters(pair: dict[str, Any], words: Words) -> str:
    angles = pair["angles"]
    rows = [
        [name, "1", fixed(value, SHOWN + 1), fixed(sigma, SHOWN + 1)]
        for name, value, sigma in zip(("bX*", "bY*", "bZ*"), pair["base"], pair["sigma_base"], strict=True)
    ]
    rows += [
        [f"{name}*", angles["unit"], fixed(angles[name], SHOWN), fixed(angles[f"s{name}"], SHOWN)]
        for name in ("omega", "phi", "kappa")
    ]
    return table(["parameter", "unit", "value", "sigma"], rows, left=2, words=words)


def _correlations(pair: dict[str, Any], words: Words) -> str:
    return correlation_table(
        ["bX*", "bY*", "bZ*", "omega*", "phi*", "kappa*"], pair["correlation"]["matrix"], words
    )


def correlation_table(names: list[str], matrix: list[list[float | None]], words: Words) -> str:
    """Lower triangle of correlations."""
    rows = [
        [name, *(fixed(value, 2) if column <= k else "" for column, value in enumerate(row))]
        for k, (name, row) in enumerate(zip(names, matrix, strict=True))
    ]
    return table(["correlation", *names], rows, words=words)


def _rinner(pair: dict[str, Any], words: Words) -> list[str]:
    found = pair["rinner"]
    lines = [words("Auxiliary unknowns ik (Rinner): from the linear system, made compatible, adjusted")]
    if found["ik"][0]["linear"] is None:
        lines.append(words("The linear system has no solution of its own for points in a plane."))
    names = ("linear", "correction", "compatible", "adjusted", "sigma")
    rows = [[row["ik"], *(fixed(row[name], SHOWN + 1) for name in names)] for row in found["ik"]]
    lines.append(table(["ik", *names], rows, words=words))
    rows = [
        [
            row["condition"],
            *("-" if row[name] is None else f"{row[name]:.1e}" for name in ("linear", "adjusted")),
        ]
        for row in found["conditions"]
    ]
    return [*lines, table(["condition", "misclosure, linear", "misclosure, adjusted"], rows, words=words)]


def _residuals(pair: dict[str, Any], words: Words) -> str:
    rows = [
        [row["id"], fixed(row["coplanarity"], 3), "" if row["used"] else words.listed("not used")]
        for row in pair["residuals"]
    ]
    return table(["point", "coplanarity [sigma]", "remark"], rows, words=words)


def _model(data: dict[str, Any], words: Words) -> str:
    model = data["model"]
    if model is None:
        known = all(pair["usable"] for pair in data["pairs"])
        no_scale = words(
            "No model of all images: two neighbouring pairs have no points in common that give the scale."
        )
        apart = words("No model of all images: not every pair of neighbouring images is oriented.")
        return no_scale if known else apart if len(data["pairs"]) > 1 else ""
    unit = data["angles"]["unit"]
    system = "object system" if model["system"] == "object" else "axes of the first image"
    lines = [
        heading(words("Model")),
        words("{system}, unit of length: the first base", system=words.listed(system)),
    ]
    counts = [str(count) for count in model["scale_points"] if count is not None]
    if counts:
        lines.append(
            words(
                "points that carried the scale from pair to pair: {counts}; all images adjusted together",
                counts=", ".join(counts),
            )
        )
    lines.append(
        words(
            "sigma0 {sigma0} [1], redundancy {redundancy}",
            sigma0=short(model["sigma0"], 4),
            redundancy=model["redundancy"],
        )
    )
    if len(data["pairs"]) > 1 and any(pair["alternatives"] for pair in data["pairs"]):
        lines.append(_decided(model["rivals"], words))
    headers = ["image", *_headed(("X0", "Y0", "Z0"), "1"), *_headed(("omega", "phi", "kappa"), unit)]
    keys = ("x", "y", "z", "omega", "phi", "kappa")
    rows = [[str(one["image"]), *_valued(one, keys)] for one in model["images"]]
    lines += ["", table(headers, rows, words=words), ""]
    rows = [[one["id"], *_valued(one, keys[:3]), _remark(one, words)] for one in model["points"]]
    lines.append(table(["point", *_headed(("X", "Y", "Z"), "1"), "remark"], rows, words=words))
    return "\n".join(lines)


def _decided(rivals: int, words: Words) -> str:
    if rivals:
        return words(
            "With other orientations of the ambiguous pairs all images fit together as well: "
            "{count:further model|further models}.",
            count=rivals,
        )
    return words("Of the orientations of ambiguous pairs only those told first fit the other images.")


def _remark(point: dict[str, Any], words: Words) -> str:
    return "" if point["remark"] is None else words.listed(point["remark"])


def _headed(names: tuple[str, ...], unit: str) -> list[str]:
    return [header for name in names for header in (f"{name} [{unit}]", "sigma")]


def _valued(row: dict[str, Any], keys: tuple[str, ...]) -> list[str]:
    return [cell for key in keys for cell in (fixed(row[key], SHOWN), fixed(row[f"s{key}"], SHOWN))]
