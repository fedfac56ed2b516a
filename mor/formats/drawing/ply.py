"""PLY: points of a project as vertices, with their σ where there are results."""

from __future__ import annotations

from pathlib import Path

import numpy as np

from mor.errors import Problem
from mor.formats.drawing.results import drawing_in_metres
from mor.formats.written import Written
from mor.project.file.nodes import Document


def write_ply(document: Document, folder: Path, target: Path) -> Written:
    """ASCII PLY in metres: x y z, and sx sy sz where there are results. Raises :class:`InputError`."""
    shown = drawing_in_metres(document, folder)
    known = np.isfinite(shown.sigma).all(axis=1).any()
    names = ("x", "y", "z", *(("sx", "sy", "sz") if known else ()))
    head = [
        "ply",
        "format ascii 1.0",
        f"comment {_one_line(shown.title)}",
        f"element vertex {len(shown.ids)}",
    ]
    head += [f"property double {name}" for name in names]
    values = np.concatenate([shown.xyz, np.nan_to_num(shown.sigma)], axis=1)[:, : len(names)]
    rows = [" ".join(map(repr, row)) for row in values.tolist()]
    text = "\n".join([*head, "end_header", *rows]) + "\n"
    notes = [*shown.notes, Problem("PLY has no names of points, no images and no observations", str(target))]
    return Written({target: text.encode()}, notes)


def _one_line(text: str) -> str:
    return " ".join(text.split())
