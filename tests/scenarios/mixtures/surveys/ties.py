"""What ties the parts of a survey besides: bars, levelling, GNSS, single angles, planes, systems."""

from __future__ import annotations

import numpy as np

from mor.types import FloatArray
from tests.scenarios.mixtures.surveys.photographs import angles
from tests.scenarios.mixtures.surveys.survey import Mark, Start, Survey
from tests.scenarios.mixtures.world import rotation


def some(survey: Survey, count: int, by: str = "") -> list[str]:
    """Points that are measured, in random order; of one kind where ``by`` says which."""
    names = used(survey)
    fit = [p for p in names if not by or survey.marks[p].by in ("both", by)]
    return [str(p) for p in survey.draw.permutation(fit)[:count]]


def used(survey: Survey) -> list[str]:
    """Object points that observations name, in the order of the points."""
    found = {
        str(row[key])
        for (section, _), (_, rows) in survey.tables.items()
        if section == "observations"
        for row in rows
        for key in ("point", "to")
        if key in row
    }
    return [p for p, mark in survey.marks.items() if p in found and mark.by != "none"]


def distances(survey: Survey, count: int) -> None:
    """Distances between points of the object: a bar, or many."""
    survey.tags.add("one distance" if count == 1 else "distances between points")
    for _ in range(count):
        a, b = some(survey, 2)
        _distance(survey, a, b)


def distances_across(survey: Survey) -> None:
    """Distances from the points of one cluster to those of the other."""
    middle = float(np.median([mark.xyz[0] for mark in survey.marks.values() if mark.by != "none"]))
    names = some(survey, 1000, "images")
    left = [p for p in names if survey.marks[p].xyz[0] < middle]
    right = [p for p in names if survey.marks[p].xyz[0] >= middle]
    survey.tags.add("clusters tied by distances")
    for _ in range(14 if left and right else 0):
        _distance(survey, str(survey.one_of(*left)), str(survey.one_of(*right)))


def _distance(survey: Survey, a: str, b: str) -> None:
    length = survey.measured(float(np.linalg.norm(survey.marks[a].xyz - survey.marks[b].xyz)))
    cells = {"from": a, "to": b, "distance": length}
    survey.row("observations", "bars", {"type": "distance", **survey.of_length}, **cells)


def levelling(survey: Survey) -> None:
    """A line over object points, marks of stations and benchmarks that nothing else sees, open or closed."""
    names = [
        *some(survey, int(survey.draw.integers(2, 8))),
        *(p for p in survey.stations.values() if survey.chance(0.4)),
    ]
    for k in range(int(survey.draw.integers(0, 3))):
        survey.marks[f"BM{k}"] = Mark(
            survey.size * survey.draw.standard_normal(3) * [1.0, 1.0, 0.1], "none", 1.0, {"x": 0.0, "y": 0.0}
        )
        names.insert(int(survey.draw.integers(len(names) + 1)), f"BM{k}")
    ends = [*names[1:], names[0]] if survey.chance(0.6) else names[1:]
    for a, b in zip(names, ends, strict=False):
        dz = survey.measured(survey.marks[b].xyz[2] - survey.marks[a].xyz[2])
        survey.row(
            "observations",
            "levelling",
            {"type": "height_difference", **survey.of_length},
            **{"from": a, "to": b},
            dz=dz,
        )


def vectors(survey: Survey) -> None:
    """GNSS vectors from a base to points and stations, or to the places of images."""
    survey.marks["base"] = Mark(survey.size * 2.0 * survey.draw.standard_normal(3), "none")
    ends: list[tuple[str, FloatArray]] = [(p, survey.marks[p].xyz) for p in some(survey, 4)]
    ends += [(p, survey.marks[p].xyz) for p in survey.stations.values() if survey.chance(0.5)]
    if survey.photos and survey.chance(0.3, "GNSS vectors to images"):
        ends += [(f"image:{name}", photo.centre) for name, photo in survey.photos.items()]
    for name, place in ends:
        d = place - survey.marks["base"].xyz
        cells = {f"d{axis}": survey.measured(v) for axis, v in zip("xyz", d, strict=True)}
        survey.row(
            "observations",
            "vectors",
            {"type": "vector", **survey.of_length},
            **{"from": "base", "to": name},
            **cells,
        )


def single_angles(survey: Survey) -> None:
    """A bearing, some angles and spatial angles between points."""
    for _ in range(int(survey.draw.integers(1, 4))):
        at, a, b = some(survey, 3)
        u, v = (survey.marks[p].xyz - survey.marks[at].xyz for p in (a, b))
        kind = survey.one_of("bearing", "angle", "spatial_angle", "vertical_direction", "horizontal_distance")
        survey.tags.add(kind)
        if kind == "bearing":
            said = {"from": at, "to": a, "bearing": survey.read(np.arctan2(u[0], u[1]))}
        elif kind == "vertical_direction":
            said = {
                "from": at,
                "to": a,
                "vertical_direction": survey.read(np.arctan2(u[2], np.hypot(u[0], u[1]))),
            }
        elif kind == "horizontal_distance":
            said = {"from": at, "to": a, "distance": survey.measured(float(np.hypot(u[0], u[1])))}
        elif kind == "angle":
            turn = (np.arctan2(v[0], v[1]) - np.arctan2(u[0], u[1])) % (2.0 * np.pi)
            said = {"at": at, "from": a, "to": b, "angle": survey.read(turn)}
        else:
            said = {
                "at": at,
                "from": a,
                "to": b,
                "angle": survey.read(np.arctan2(np.linalg.norm(np.cross(u, v)), u @ v)),
            }
        keys = survey.of_length if kind == "horizontal_distance" else survey.of_angle
        survey.row("observations", kind, {"type": kind, **keys}, **said)


def plane(survey: Survey) -> None:
    """Points of the plane of a facade, or near a plane, said to be on one."""
    names = some(survey, 60)
    level = np.array([survey.marks[p].xyz[1] for p in names])
    near = [names[i] for i in np.argsort(np.abs(level - np.median(level)))[:7]]
    off = float(np.ptp([survey.marks[p].xyz[1] for p in near]))
    survey.more["features"] = [
        {
            "type": "plane",
            "id": "wall",
            "points": near,
            "sigma": survey.in_length(max(off, survey.sigma_length)),
        }
    ]


def system(survey: Survey) -> None:
    """Some points measured in a system of their own, some components of them only."""
    origin, D = survey.size * survey.draw.standard_normal(3), rotation(1.5 * survey.draw.standard_normal(3))
    partly, scale_free = survey.chance(0.4, "system in part"), survey.chance(0.4, "system of free scale")
    scale = float(survey.draw.uniform(0.3, 3.0)) if scale_free else 1.0
    cells: dict[str, object] = {"id": "part"}
    cells |= {axis: survey.start(v) for axis, v in zip("xyz", survey.origin + origin, strict=True)}
    cells |= {a: Start(survey.in_angle(v)) for a, v in zip(("omega", "phi", "kappa"), angles(D), strict=True)}
    cells["scale"] = Start(scale) if scale_free else 1.0
    survey.row("systems", "systems", {} if scale_free else {"fixed": ["scale"]}, **cells)  # type: ignore[arg-type]
    for p in some(survey, int(survey.draw.integers(6, 14))):
        own = scale * D @ (survey.marks[p].xyz - origin)
        read = {axis: survey.measured(v) for axis, v in zip("xyz", own, strict=True)}
        if partly:
            del read[str(survey.one_of("x", "y", "z"))]
        survey.row("observations", "local", {"type": "local", **survey.of_length}, system="part", point=p, **read)
