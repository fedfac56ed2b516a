"""Theodolites of a survey: levelled or tilted, directions, zenith angles and distances in any choice of them."""

from __future__ import annotations

from typing import Any

import numpy as np

from mor.types import FloatArray
from tests.scenarios.mixtures.surveys.photographs import angles
from tests.scenarios.mixtures.surveys.survey import Mark, Start, Survey
from tests.scenarios.mixtures.world import about_z, rotation

READS = {
    "total": (True, True, True), "theodolite": (True, True, False), "horizontal": (True, False, False),
    "zenith and distance": (False, True, True), "horizontal and distance": (True, False, True),
    "tilted": (True, True, True), "tilted without distances": (True, True, False),
}  # fmt: skip
"""What is read: horizontal, zenith, distance."""
SHARES = (0.35, 0.25, 0.07, 0.06, 0.07, 0.12, 0.08)


def stations(survey: Survey, count: int) -> None:
    """Stations over marks or anywhere, each with what it reads."""
    for k in range(count):
        kind = str(survey.draw.choice(list(READS), p=SHARES))
        survey.tags.add(f"station {kind}")
        far = survey.size * survey.draw.uniform(0.6, 1.2) * (0.25 if "room" in survey.tags else 1.0)
        angle = survey.draw.uniform(0.0, 2.0 * np.pi)
        if "facade" in survey.tags:
            angle = survey.draw.uniform(-2.5, -0.6)
        over = f"mark {k}"
        place = np.array([far * np.cos(angle), far * np.sin(angle), 0.1 * survey.size * survey.draw.standard_normal()])
        survey.marks[over] = Mark(place, "none")
        survey.stations[f"s{k}"] = over
        _station(survey, f"s{k}", over, kind)


def _station(survey: Survey, name: str, over: str, kind: str) -> None:
    height = 0.0 if survey.chance(0.3) else round(0.03 * survey.size * survey.draw.uniform(0.5, 1.0), 4)
    D = about_z(float(survey.draw.uniform(-np.pi, np.pi)))
    level: dict[str, Any] = {}
    if kind.startswith("tilted"):
        D = rotation(survey.one_of(0.02, 0.3) * survey.draw.standard_normal(3)) @ D
        level = {"level": "free"}
    if kind != "zenith and distance":
        turn = dict(zip(("omega", "phi", "kappa"), angles(D), strict=True))
        said = turn if level else {"kappa": turn["kappa"]}
        survey.row(
            "stations", f"stations {level}", level, id=name, point=over, height=survey.in_length(height),
            **{key: Start(survey.in_angle(value)) for key, value in said.items()},
        )  # fmt: skip
    reads = READS[kind]
    ready = float(survey.one_of(0.4, 0.8, 1.0))
    targets = [p for p in survey.seen_marks("stations") if survey.draw.random() < ready * survey.marks[p].share]
    others = [p for p in survey.stations.values() if p != over]
    targets += [p for p in others if survey.chance(0.7)]
    for target in targets:
        _sight(survey, name, over, target, height, D, reads)


def _sight(
    survey: Survey, name: str, over: str, to: str, height: float, D: FloatArray, reads: tuple[bool, ...]
) -> None:
    above = 0.0 if survey.chance(0.7) or D[2, 2] != 1.0 else 0.02 * survey.size
    up = np.array([0.0, 0.0, 1.0])
    away = survey.place(to, name) + above * up - survey.marks[over].xyz - height * up
    x, y, z = D @ away
    heights = {"to_height": survey.in_length(above)}
    if reads[0]:
        cells: dict[str, Any] = {
            "station": name,
            "to": to,
            **heights,
            "horizontal": survey.read(np.arctan2(x, y) % (2 * np.pi)),
        }
        if reads[1]:
            cells["zenith"] = survey.read(np.arctan2(np.hypot(x, y), z))
        survey.row("observations", "readings", {"type": "zenith_directions", **survey.of_angle}, **cells)
    elif reads[1]:
        zenith = survey.read(np.arctan2(np.hypot(away[0], away[1]), away[2]))
        cells = {
            "from": over,
            "from_height": survey.in_length(height),
            "to": to,
            **heights,
            "zenith_angle": zenith,
        }
        survey.row("observations", "zenith angles", {"type": "zenith_angle", **survey.of_angle}, **cells)
    if reads[2] and survey.chance(0.9):
        begin = {"from": name} if reads[0] else {"from": over, "from_height": survey.in_length(height)}
        length = survey.measured(float(np.linalg.norm(away)))
        survey.row(
            "observations",
            f"distances {reads[0]}",
            {"type": "distance", **survey.of_length},
            **begin,
            to=to,
            distance=length,
            **heights,
        )
