"""A project whose planned observations say what is visible, with the rows of all that is."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from functools import partial
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
import polars as pl

from mor.arrays import FloatArray, IntArray
from mor.counting import counted
from mor.errors import InputError, Problem
from mor.observations import IMAGE_TYPES, ObservationType
from mor.planning.visibility.local_axes import upwards
from mor.planning.visibility.sights import Limits, outcomes
from mor.planning.visibility.surfaces import Surroundings, surroundings
from mor.planning.visibility.targets import NO_PLACE, Targets, named, targets_named, targets_of
from mor.planning.visibility.viewpoints import Image, Start, image, instruments
from mor.project.edge import ImageScale, UnitError
from mor.project.file.model import Observations
from mor.project.file.nodes import Document
from mor.project.file.validation import validate
from mor.project.network.build import read_things
from mor.project.network.reading import Reading
from mor.project.observations.observation_rows import group_name
from mor.project.tables.tables import Place
from mor.quality.design.sighted import REASONS, Sighted
from mor.units import ANGLE, IMAGE, LENGTH, Quantity

_SECTIONS = ("observations", "candidates")
_BETWEEN_FEET = ("ellipsoid_arc", "ellipsoid_chord", "mean_sea_level_distance")
"""Types of the earth that somebody has reduced: no sight leads along them."""


def sights(reading: Reading) -> dict[str, ObservationType]:
    """Types of observations that are made along a line of sight between two places."""
    return {
        key: type_
        for key, type_ in {**reading.types, "image": IMAGE_TYPES["mor"]}.items()
        if len(type_.references) == 2 and not type_.between_marks and key not in _BETWEEN_FEET
    }


def with_visible(document: Document, folder: Path) -> tuple[Document, tuple[Sighted, ...]]:
    """The document with rows in place of every ``visible``, and what each of these sees. Raises :class:`InputError`.

    Where the things of the project cannot be read it comes back as it is: whoever reads it tells all mistakes.
    """
    project = validate(document)
    wanted = [
        (section, number, entry)
        for section in _SECTIONS
        for number, entry in enumerate(getattr(project, section))
        if entry.visible is not None
    ]
    if not wanted:
        return document, ()
    reading = read_things(project, document, folder, planned=True)
    if reading.problems:
        return document, ()
    start = Start(reading)
    targets = targets_of(reading, start.values["point"])
    around = surroundings(reading, targets)
    data: dict[str, Any] = {**document.data, **{s: list(document.data.get(s) or []) for s in _SECTIONS}}
    frames, sighted = dict(document.frames), []
    for section, number, entry in wanted:
        scene = Scene(reading, start, targets, around, reading.at(section, number))
        found = _seen(scene, entry, section, number)
        if found is None:
            continue
        frame, told = found
        sighted.append(told)
        label = f"what is visible ({section} {number + 1})"
        frames[label] = frame
        given = {key: value for key, value in data[section][number].items() if key != "visible"}
        data[section][number] = {**given, "name": told.name, "file": label}
    if reading.problems:
        raise InputError(reading.problems)
    return replace(document, data=data, frames=frames), tuple(sighted)


class Scene(NamedTuple):
    """Data from which the sights of an entry are computed."""

    reading: Reading
    start: Start
    targets: Targets
    around: Surroundings
    place: Place

    def mistake(self, words: str) -> None:
        """Tell a mistake of the entry."""
        self.reading.problems.append(self.place.problem(f"visible: {words}", "visible"))


class Viewpoint(NamedTuple):
    """Where sights begin."""

    name: str
    origin: FloatArray
    point: int
    """Block of the point it is on, which it does not sight; −1 for none."""
    up: FloatArray
    """(3,) upwards there."""
    image: Image | None = None
    border: float = 0.0
    """Margin of the format, unit of the camera."""


def _seen(
    scene: Scene, entry: Observations, section: str, number: int
) -> tuple[pl.DataFrame, Sighted] | None:
    """Rows of everything that an entry sees; ``None`` if there are mistakes."""
    known = sights(scene.reading)
    type_ = known.get(entry.type)
    wanted, before = entry.visible, len(scene.reading.problems)
    assert wanted is not None
    if type_ is None:
        scene.mistake(
            f"{entry.type} has no line of sight between two places (those that do: {', '.join(known)})"
        )
        return None
    viewpoints = _viewpoints(scene, entry, type_)
    chosen = targets_named(wanted.to, scene.targets, scene.place, "visible: to", scene.reading.problems)
    limits = _limits(scene, entry, type_)
    height = _height(scene, entry, "to_height")
    nowhere = [scene.targets.names[k] for k in chosen if not np.isfinite(scene.targets.positions[k]).all()]
    nowhere += [one.name for one in viewpoints if not np.isfinite(one.origin).all()]
    for name in nowhere:
        scene.mistake(f"{name}: {NO_PLACE}")
    if len(scene.reading.problems) > before:
        return None
    from_, to, counts = _sights(scene, viewpoints, chosen, limits, height, _is_once(entry, type_))
    name = group_name(entry, number)
    if not len(from_):
        told = ", ".join(f"{c} {r}" for c, r in zip(counts, REASONS, strict=True) if c)
        scene.mistake(f"nothing is seen: of {counted(sum(counts), 'sight', 'sights')} {told or 'none'}")
        return None
    often = np.bincount(to, minlength=len(scene.targets.names))[chosen]
    names = [[scene.targets.names[k] for k in chosen[often == n]] for n in (0, 1)]
    frame = _frame(scene, type_, [one.name for one in viewpoints], from_, to)
    return frame, Sighted(name, section, counts, tuple(names[0]), tuple(names[1]))


def _sights(
    scene: Scene, viewpoints: Sequence[Viewpoint], chosen: IntArray, limits: Limits, height: float, once: bool
) -> tuple[IntArray, IntArray, tuple[int, ...]]:
    """Numbers of the viewpoints and of the targets of all sights that are seen, and counts of all by their reason.

    With ``once`` two points sight each other one way: from the one that stands first.
    """
    blocks = scene.targets.blocks
    given = scene.targets.positions
    positions = given + height * upwards(scene.reading, given)
    counts = np.zeros(len(REASONS), dtype=np.int64)
    from_, to = [np.zeros(0, dtype=np.int64)], [np.zeros(0, dtype=np.int64)]
    sighted = set(blocks[chosen].tolist())
    done: list[int] = []
    for number, one in enumerate(viewpoints):
        left = chosen[(blocks[chosen] != one.point)]
        if once and one.point in sighted:
            left = left[~np.isin(blocks[left], done)]
        if once:
            done.append(one.point)
        found = outcomes(
            one.origin,
            one.up,
            positions[left],
            scene.around.normals[left],
            limits,
            scene.around,
            partial(one.image.shows, border=one.border) if one.image else None,
        )
        counts += np.bincount(found, minlength=len(REASONS))
        to.append(left[found == 0])
        from_.append(np.full(len(to[-1]), number))
    return np.concatenate(from_), np.concatenate(to), tuple(counts.tolist())


def _frame(
    scene: Scene, type_: ObservationType, viewpoints: Sequence[str], from_: IntArray, to: IntArray
) -> pl.DataFrame:
    """Rows of a table of the type, with the set of a station where its name has one."""
    sets = scene.reading.sets
    first, second = (reference.name for reference in type_.references)
    columns = {
        first: pl.Series([sets.get(name, (name, ""))[0] for name in viewpoints], dtype=pl.String).gather(
            from_
        ),
        second: pl.Series(list(scene.targets.names), dtype=pl.String).gather(to),
    }
    if first == "station" and any(name in sets for name in viewpoints):
        of_set = pl.Series([sets.get(name, (name, None))[1] for name in viewpoints], dtype=pl.String)
        columns["set"] = of_set.gather(from_)
    return pl.DataFrame(columns)


def _is_once(entry: Observations, type_: ObservationType) -> bool:
    assert entry.visible is not None
    return "point" in type_.references[0].among and not entry.visible.both_ways


def _viewpoints(scene: Scene, entry: Observations, type_: ObservationType) -> list[Viewpoint]:
    """Images, stations, systems or points that the patterns ``at`` stand for; of stations points as well."""
    reading, wanted = scene.reading, entry.visible
    assert wanted is not None
    space = type_.references[0].among[0]
    if space == "point":
        chosen = targets_named(wanted.at, scene.targets, scene.place, "visible: at", reading.problems)
        return _at(scene, "point", chosen.tolist(), _height(scene, entry, "from_height"))
    if wanted.both_ways:
        scene.mistake("both_ways is for sights between points")
    names = reading.shop.things[space].ids
    mistakes: list[Problem] = []
    found = named(wanted.at, names, space, scene.place, "visible: at", mistakes)
    if (
        space == "station" and mistakes
    ):  # directions are observed on points, too, that are declared as no station
        others = [p for p in wanted.at if not named([p], names, space, scene.place, "", [])]
        points = targets_named(others, scene.targets, scene.place, "visible: at", reading.problems)
        return [*_at(scene, space, found), *_at(scene, "point", points.tolist())]
    reading.problems += mistakes
    if space != "image":
        return _at(scene, space, found)
    without = {
        reading.shop.things["camera"].ids[int(c)] for c in reading.shop.things["image"].parts["camera"][found]
    }
    for camera in sorted(name for name in without if reading.project.cameras[name].image is None):
        scene.mistake(f"camera {camera!r} has no format (image: {{width, height, pixel}})")
    for camera in sorted(without & reading.scanners.keys()):
        scene.mistake(f"camera {camera!r} is a line scanner: list the points that its images have")
    return [_from_image(scene, wanted.border, k) for k in found]


def _from_image(scene: Scene, border: str | None, number: int) -> Viewpoint:
    images = scene.reading.shop.things["image"]
    camera = scene.reading.shop.things["camera"].ids[int(images.parts["camera"][number])]
    found = image(scene.reading, scene.start, number)
    margin = _length(scene, "border", border or "0", IMAGE, scene.reading.scales[camera])
    up = upwards(scene.reading, found.centre[None])[0]
    return Viewpoint(images.ids[number], found.centre, -1, up, found, margin)


def _at(scene: Scene, space: str, numbers: Sequence[int], height: float = 0.0) -> list[Viewpoint]:
    things = scene.reading.shop.things[space]
    chosen = np.array(numbers, dtype=np.int64)
    origins = instruments(scene.reading, scene.start, space, chosen, height)
    blocks = things.parts["position"][chosen]
    return [
        Viewpoint(things.ids[k], origin, int(block), up)
        for k, origin, block, up in zip(
            numbers, origins, blocks, upwards(scene.reading, origins), strict=True
        )
    ]


def _height(scene: Scene, entry: Observations, key: str) -> float:
    """Height of an instrument or target that all rows have."""
    try:
        return scene.reading.edge.number(entry.values.get(key, "0"), LENGTH)
    except UnitError:
        return 0.0  # told when the rows are read


def _limits(scene: Scene, entry: Observations, type_: ObservationType) -> Limits:
    """Limits of the sights of an entry; those that do not fit its type are mistakes."""
    wanted = entry.visible
    assert wanted is not None
    of_images = type_.references[0].among == ("image",)
    if wanted.border is not None and not of_images:
        scene.mistake("border is for images")
    if wanted.steepest is not None and of_images:
        scene.mistake("steepest is for instruments; an image has its format")
    given = {
        "nearest": (wanted.nearest, LENGTH),
        "farthest": (wanted.farthest, LENGTH),
        "incidence": (wanted.incidence, ANGLE),
        "steepest": (wanted.steepest, ANGLE),
    }
    return Limits(
        **{key: _length(scene, key, text, of) for key, (text, of) in given.items() if text is not None}
    )


def _length(scene: Scene, key: str, text: str, quantity: Quantity, scale: ImageScale | None = None) -> float:
    """A length or an angle, 0 or more; anything else is a mistake."""
    try:
        found = scene.reading.edge.number(text, quantity, "", scale)
        if found < 0.0:
            raise UnitError(f"found {text}, expected 0 or more")
    except UnitError as error:
        scene.mistake(f"{key}: {error}")
        return 0.0
    return found
