"""A few hundred mutants of all formats; ``python -m tests.formats.mutants`` reads more of them."""

from __future__ import annotations

from pathlib import Path

import pytest

from .mutants import faults, materials


@pytest.mark.parametrize(
    "name",
    [
        *(
            "colmap text",
            "colmap binary",
            "opensfm",
            "bal",
            "metashape",
            "metashape projection",
            "photomodeler",
            "starnet",
            "starnet vectors",
            "starnet project",
            "gkf",
            "gcp",
            "bundler",
            "textbook",
            "dynadjust",
            "snap",
            "sinex",
            "jag3d",
            "dbat",
            "pix4d",
            "pix4d camera",
            "metashape project",
            "metashape tie points",
            "reference pane",
            "jag3d script",
            "dynaml",
            "landxml",
            "landxml plan",
            "alicevision",
            "gsib",
            "gsio",
        ),
        *(
            "sdrb",
            "m5b",
            "jxlb",
            "rw5b",
            "idx",
            "nikon",
            "topcon",
            "topcon stream",
            "fbk",
            "comp3d",
            "comp3d on the earth",
            "sokkia",
            "geodimeter",
        ),
    ],
)
def test_no_mutant_breaks_a_reader(tmp_path: Path, name: str) -> None:
    assert list(faults(name, 2026, 10, tmp_path)) == []


def test_every_material_is_tried(tmp_path: Path) -> None:
    assert len(materials(tmp_path)) == 44
