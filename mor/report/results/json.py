"""``results.json``: everything but the long residual table as plain data, in a stable order."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np
import polars as pl

from mor.parameters.kinds import INTERIORS
from mor.quality.solved import Solved
from mor.report.identity import Identity, identity_of
from mor.report.motions.table import epoch_rows, motion_table
from mor.report.notes import note_rows
from mor.report.parameters import component_rows, other_rows
from mor.report.results.failure import failure
from mor.report.results.summary import summary
from mor.report.tables.checks import check_rows
from mor.report.tables.ellipses import chosen_pairs, relative_rows
from mor.report.tables.estimates import (
    group_table,
    image_table,
    interior_rows,
    pair_table,
    point_table,
    station_table,
    system_table,
    variance_components,
)
from mor.report.tables.features import feature_table
from mor.report.tables.gross_errors.hypotheses import possible_causes
from mor.report.tables.gross_errors.suspects import suspects
from mor.report.tables.observations import observation_table
from mor.report.tables.reliability import fixed_point_rows, gross_errors
from mor.report.trajectories.table import boresight_rows, knot_table
from mor.report.verdict.group_tests import verdict_rows
from mor.report.verdict.reliability_map import reliability_rows

INLINE = 10_000
"""Tables of up to this many rows stand in ``results.json`` itself."""


def results(
    solved: Solved, tables: dict[str, str], of: Identity, files: Sequence[str] | None = None
) -> dict[str, Any]:
    """Content of ``results.json``, ``of`` what was read.

    ``files`` are the names of all files of the run in its folder, ``tables`` those of the tables among them. Long
    tables of points and images stand only there, or in the content itself if ``files`` is ``None``: then nothing is
    written.
    """
    beside = files is not None
    points, images = point_table(solved), image_table(solved)
    return {
        **summary(solved),
        "identity": identity_of(solved.network.project, of),
        "notes": note_rows(solved.network.notes, of.folder),
        "verdict": verdict_rows(solved),
        "reliability": reliability_rows(solved),
        "points": _rows(points, beside),
        "images": _with_interiors(_rows(images, beside), solved),
        "motions": motion_table(solved).to_dicts(),
        "epochs": epoch_rows(solved),
        "trajectories": _rows(knot_table(solved), beside) if solved.network.trajectories else [],
        "boresights": boresight_rows(solved),
        "cameras": interior_rows(solved),
        "stations": station_table(solved).to_dicts(),
        "systems": system_table(solved).to_dicts(),
        "pairs": pair_table(solved).to_dicts(),
        "features": feature_table(solved).to_dicts(),
        "others": [row for row in other_rows(solved) if not row["kind"].startswith("interior/")],
        "groups": group_table(solved).to_dicts(),
        "variance_components": variance_components(solved),
        "gross_errors": gross_errors(solved),
        "suspects": suspects(solved),
        "possible_causes": possible_causes(solved),
        "fixed_points": fixed_point_rows(solved),
        "relative": relative_rows(solved, chosen_pairs(solved)),
        "checks": check_rows(solved),
        "failure": failure(solved),
        "tables": tables,
        "files": list(files or ()),
        "residuals": observation_table(solved).to_dicts() if entries(solved) <= INLINE else None,
    }


def entries(solved: Solved) -> int:
    """Rows of the table of residuals: observations, excluded ones and checks among them."""
    return sum(int(np.count_nonzero(group.mask)) for group in solved.adjustment.problem.groups)


def _rows(frame: pl.DataFrame, beside: bool) -> list[dict[str, Any]] | None:
    return frame.to_dicts() if frame.height <= INLINE or not beside else None


def _with_interiors(images: list[dict[str, Any]] | None, solved: Solved) -> list[dict[str, Any]] | None:
    """Images with the interior orientation they have of their own."""
    if images is None:
        return None
    interiors = image_interiors(solved)
    return with_interiors(images, interiors)


def with_interiors(
    images: list[dict[str, Any]], interiors: Mapping[str, dict[str, Any]]
) -> list[dict[str, Any]]:
    """The same with those interiors, by image."""
    return [{**row, "interior": interiors[row["id"]]} if row["id"] in interiors else row for row in images]


def image_interiors(solved: Solved) -> dict[str, dict[str, Any]]:
    """Components of the interior orientation that an image has of its own, by image, where it has some."""
    images, cameras = solved.network.things["image"], solved.network.project.cameras
    found = {}
    for i, (name, camera) in enumerate(zip(images.ids, images.parts["camera"], strict=True)):
        model = cameras[solved.network.things["camera"].ids[camera]]
        if model.image_variant:
            kind, number = INTERIORS[model.model], int(images.parts["interior"][i])
            components = component_rows(solved, kind.key, number, kind.components)
            found[name] = {own: components[own] for own in model.image_variant}
    return found
