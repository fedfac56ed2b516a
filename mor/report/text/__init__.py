"""The text report: one file for each section, put together in one order."""

from __future__ import annotations

import polars as pl

from mor.quality.solved import Solved
from mor.report.text import (
    cameras,
    checks,
    features,
    groups,
    head,
    images,
    others,
    points,
    reliability,
    residuals,
    stations,
    undetermined,
)


def text_report(solved: Solved, table: pl.DataFrame) -> str:
    """The whole report. Sections without content are left out."""
    sections = [
        head.section(solved),
        undetermined.section(solved),
        checks.section(solved),
        reliability.section(solved),
        groups.section(solved),
        cameras.section(solved),
        images.section(solved),
        stations.section(solved),
        features.section(solved),
        others.section(solved),
        points.section(solved),
        residuals.section(solved, table),
    ]
    return "\n\n".join(section for section in sections if section) + "\n"
