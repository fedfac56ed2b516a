"""What holds a survey: nothing, one length, whole control points, single coordinates of many, points far beyond."""

from __future__ import annotations

import numpy as np

from tests.scenarios.mixtures.surveys.survey import Mark, Survey
from tests.scenarios.mixtures.surveys.ties import some

KINDS = ("free", "free with a length", "full", "scattered", "plan and heights", "few", "marks of stations")
SHARES = (0.17, 0.16, 0.17, 0.17, 0.15, 0.08, 0.1)


def control(survey: Survey) -> None:
    """Fixed or observed coordinates, and the datum that goes with them."""
    kind = str(survey.draw.choice(KINDS, p=SHARES))
    if kind == "marks of stations" and len(survey.stations) < 2:
        kind = "scattered"
    if "towers" in survey.tags:
        kind = "far beyond"
    survey.tags.add(f"control {kind}")
    free = kind.startswith("free")
    survey.more["datum"] = "free" if free else "fixed"
    if free:
        return
    sigma = float(survey.one_of(0.0, 1.0, 5.0)) * survey.sigma_length
    patterns = {
        "full": ["xyz"] * int(survey.draw.integers(3, 7)),
        "scattered": ["x", "y", "z"] * int(survey.draw.integers(3, 6)),
        "plan and heights": ["xy"] * int(survey.draw.integers(2, 5)) + ["z"] * int(survey.draw.integers(3, 6)),
        "few": ["xyz", "xyz", "z"],
    }.get(kind, [])
    for p, pattern in zip(some(survey, len(patterns)), patterns, strict=False):
        survey.marks[p].control = dict.fromkeys(pattern, sigma)
    if kind == "marks of stations":
        for p in survey.stations.values():
            survey.marks[p].control = dict.fromkeys("xyz", sigma)


def far_marks(survey: Survey) -> None:
    """Church towers: control far beyond the object, for stations alone; made before these measure."""
    for k in range(4):
        angle = 1.6 * k + survey.draw.uniform(-0.5, 0.5)
        far = survey.size * survey.draw.uniform(8.0, 30.0)
        xyz = np.array([far * np.cos(angle), far * np.sin(angle), 0.02 * far])
        survey.marks[f"tower {k}"] = Mark(xyz, "stations", 1.0, dict.fromkeys("xyz", 0.0))
    survey.tags.add("towers")
