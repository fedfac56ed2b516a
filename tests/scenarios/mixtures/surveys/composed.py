"""Random surveys: a referee of the start values that has nothing in common with ``mixture`` but the instruments."""

from __future__ import annotations

from tests.scenarios.mixtures.surveys.control import control, far_marks
from tests.scenarios.mixtures.surveys.instruments import stations
from tests.scenarios.mixtures.surveys.photographs import (
    measure_photographs,
    photographs,
    write_cameras,
    write_images,
)
from tests.scenarios.mixtures.surveys.scenes import scene, write_points
from tests.scenarios.mixtures.surveys.survey import Survey
from tests.scenarios.mixtures.surveys.ties import (
    distances,
    distances_across,
    levelling,
    plane,
    single_angles,
    some,
    system,
    used,
    vectors,
)


def composed(seed: int, wrong: float = 0.0) -> Survey:
    """A survey of a seed, a share of its image points with each other's names.

    Of worlds in which hardly anything is measured it is the next one.
    """
    for again in range(100):
        survey = _drawn(seed + 1000003 * again)
        if len(used(survey)) >= 8:
            break
    survey.seed = seed
    exchange_names(survey, wrong)
    finish(survey)
    return survey


def exchange_names(survey: Survey, share: float) -> None:
    """Exchange the names of two points in an image, until a share of all image points is wrong."""
    rows = [row for row in _rows(survey) if "image" in row]
    for k in survey.draw.permutation(len(rows))[: round(0.5 * share * len(rows))].tolist():
        others = [row for row in rows if row["image"] == rows[k]["image"] and row is not rows[k]]
        if others:
            other = others[int(survey.draw.integers(len(others)))]
            rows[k]["point"], other["point"] = other["point"], rows[k]["point"]


def _drawn(seed: int) -> Survey:
    survey = scene(seed)
    images = int(survey.draw.choice([0, 2, 3, 5, 8, 12, 20, 35], p=[0.08, 0.1, 0.15, 0.2, 0.2, 0.15, 0.08, 0.04]))
    count = int(survey.draw.choice([0, 1, 2, 3, 5, 8], p=[0.25, 0.2, 0.25, 0.15, 0.1, 0.05]))
    count = max(count, 2) if images == 0 else count
    if count and survey.chance(0.1):
        far_marks(survey)
    stations(survey, count)
    if images:
        photographs(survey, images)
        measure_photographs(survey)
    _further(survey)
    prune(survey)
    return survey


def finish(survey: Survey) -> None:
    """What holds the survey, and the tables of points, cameras and images."""
    control(survey)
    if "control free with a length" in survey.tags:
        distances(survey, 1)
    _write(survey)


def _further(survey: Survey) -> None:
    if len(used(survey)) < 3:
        return
    if "two clusters" in survey.tags and survey.chance(0.3):
        distances_across(survey)
    if survey.chance(0.15):
        distances(survey, int(survey.draw.integers(2, 9)))
    for share, ingredient in (
        (0.25, levelling),
        (0.15, vectors),
        (0.2, single_angles),
        (0.1, plane),
        (0.15, system),
    ):
        if survey.chance(share, ingredient.__name__):
            ingredient(survey)


def prune(survey: Survey) -> None:
    """Leave out what is hardly measured: points of few components, frames of few points."""
    for _ in range(4):
        told = dict.fromkeys(survey.marks, 0)
        sights: dict[str, int] = dict.fromkeys([*survey.photos, *survey.stations], 0)
        for row in _rows(survey):
            target = str(row.get("point", row.get("to", "")))
            told[target] = told.get(target, 0) + sum(
                k in row for k in ("x", "y", "z", "horizontal", "zenith", "distance", "zenith_angle", "dx")
            )
            frame = str(row.get("image", row.get("station", "")))
            sights[frame] = sights.get(frame, 0) + 1
        poor = {p for p, mark in survey.marks.items() if mark.by != "none" and told[p] < 4}
        blind = {p for p in survey.photos if sights[p] < 7}
        unread = {s for s in survey.stations if _is_set(survey, s) and sights[s] < 4}
        _take_away(survey, poor, blind | unread)


def _is_set(survey: Survey, name: str) -> bool:
    return any(
        row["id"] == name for (section, _), (_, rows) in survey.tables.items() if section == "stations" for row in rows
    )


def _rows(survey: Survey) -> list[dict[str, object]]:
    return [row for (section, _), (_, rows) in survey.tables.items() if section == "observations" for row in rows]  # type: ignore[misc]


def _take_away(survey: Survey, points: set[str], frames: set[str]) -> None:
    refers = ("point", "to", "from", "at", "image", "station", "id")
    for key, (keys, rows) in list(survey.tables.items()):
        kept = [row for row in rows if not any(str(row.get(name, "")) in points | frames for name in refers)]
        kept = [row for row in kept if str(row.get("to", "")).removeprefix("image:") not in frames]
        survey.tables[key] = (keys, kept)
        if not kept:
            del survey.tables[key]
    for feature in survey.more.get("features", []):
        feature["points"] = [p for p in feature["points"] if p not in points]
    for p in points:
        del survey.marks[p]
    for frame in frames:
        survey.photos.pop(frame, None)
        over = survey.stations.pop(frame, None)
        if over is not None and not any(over in row.values() for row in _rows(survey)):
            survey.marks.pop(over, None)
    if any(len(feature["points"]) < 5 for feature in survey.more.get("features", [])):
        del survey.more["features"]


def _write(survey: Survey) -> None:
    rough: dict[str, float] = {}
    if survey.photos and survey.chance(0.12, "rough poses"):
        rough = {name: 0.03 for name in survey.photos if survey.draw.random() < 0.7}
    if survey.chance(0.08, "rough points"):
        for p in some(survey, len(survey.marks) // 2):
            survey.marks[p].rough = 0.01 * survey.size
    write_points(survey)
    write_cameras(survey)
    write_images(survey, rough)


__all__ = ["composed", "finish", "prune"]
