"""Images: exterior orientation with σ, number of points, residuals."""

from __future__ import annotations

from collections.abc import Mapping

import polars as pl

from mor.parameters.kinds import IMAGE_VELOCITY, ROTATION_RATE
from mor.project.edge import ImageScale
from mor.project.file.model import Project
from mor.quality.solved import Solved
from mor.report.edge import angle_unit_of
from mor.report.layout import ANGLE_DIGITS, DIGITS, fixed, heading, table
from mor.report.tables.estimates import image_table
from mor.report.words.language import ENGLISH, Words


def section(solved: Solved, words: Words = ENGLISH) -> str:
    """Two tables: positions and attitudes."""
    frame = image_table(solved)
    if frame.height == 0:
        return ""
    project, scales = solved.network.project, solved.network.scales
    return "\n".join([heading(words("Images")), *listed(frame, project, scales, words)])


def listed(
    frame: pl.DataFrame, project: Project, scales: Mapping[str, ImageScale], words: Words
) -> list[str]:
    """The rows of a table of images; ``scales`` are those of image coordinates, by camera."""
    unit, angle = project.units.length, angle_unit_of(project)
    d, a = DIGITS[unit], ANGLE_DIGITS[angle]
    units = {name: scale.coordinate_unit for name, scale in scales.items()}
    positions, attitudes = [], []
    for row in frame.to_dicts():
        sigmas = [fixed(row[f"s{name}"], d) for name in "xyz"]
        values = [fixed(row[name], d) for name in "xyz"]
        positions.append(
            [
                row["id"],
                row["camera"],
                *values,
                *sigmas,
                str(row["points"]),
                fixed(row["rms"], 5),
                units[row["camera"]],
            ]
        )
        angles = [fixed(row[name], a) for name in ("omega", "phi", "kappa")]
        attitudes.append([row["id"], *angles, *(fixed(row[f"s{n}"], a) for n in ("omega", "phi", "kappa"))])
    headers = [
        "image",
        "camera",
        *(f"{n} [{unit}]" for n in ("X0", "Y0", "Z0", "sX0", "sY0", "sZ0")),
        "points",
    ]
    angle_headers = ["omega", "phi", "kappa", "somega", "sphi", "skappa"]
    return [
        table([*headers, "rms v", "unit"], positions, 2, words, last_left=True),
        "",
        table(["image", *(f"{name} [{angle}]" for name in angle_headers)], attitudes, words=words),
        *(["", motions] if (motions := _motions(frame, unit, angle, words)) else []),
    ]


def _motions(frame: pl.DataFrame, unit: str, angle: str, words: Words) -> str:
    """Velocities and rates of rotation of the images that are read out row by row; nothing if none is."""
    names = [*IMAGE_VELOCITY.names, *ROTATION_RATE.names]
    if names[0] not in frame.columns:
        return ""
    said = [(name, unit if name in IMAGE_VELOCITY.names else angle) for name in names]
    rows = [
        [row["id"], *(text for name in names for text in (fixed(row[name], 3), fixed(row[f"s{name}"], 3)))]
        for row in frame.filter(pl.col(names[0]).is_not_null()).to_dicts()
    ]
    tables = [
        table(
            ["image", *(text for name, of in some for text in (f"{name} [{of}/s]", f"s{name}"))],
            [[row[0], *row[1 + 2 * first : 7 + 2 * first]] for row in rows],
            words=words,
        )
        for first, some in ((0, said[:3]), (3, said[3:]))
    ]
    return "\n\n".join(tables)
