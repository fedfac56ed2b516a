"""Prior knowledge: observed parameters and differences, levels, image-variant components."""

from __future__ import annotations

import numpy as np

from mor.errors import Problem, nearest
from mor.geometry.arrays import IntArray
from mor.observations import OBSERVED_DIFFERENCES, OBSERVED_PARAMETERS, PLAIN_TYPES, ObservationGroup
from mor.parameters.kinds import INTERIORS, KINDS
from mor.project.edge import UnitError
from mor.project.entities import BlockStore, unknown_name
from mor.project.model import Observations
from mor.project.reading import Reading
from mor.project.tables import Column, Rows, read_table
from mor.units import ANGLE

PARTS = {
    "camera": ("interior", "eccentricity"),
    "image": ("position", "rotation", "height", "interior"),
    "station": ("position", "rotation", "height"),
    "system": ("position", "rotation", "scale", "offset"),
    "pair": ("base", "rotation"),
    "point": ("position",),
    "instrument": ("distance meter", "refraction"),
}
"""Namespaces a parameter can be named in (``camera C1``), and the parts that have its components."""


def prior_groups(reading: Reading) -> list[ObservationGroup]:
    """One group of observed parameters for every kind of block that has a σ somewhere."""
    groups = []
    for kind, store in reading.shop.stores.items():
        sigma = store.all_sigma()
        rows = np.flatnonzero(np.isfinite(sigma).any(axis=1)) if len(sigma) else np.zeros(0, dtype=np.int64)
        if len(rows) == 0:
            continue
        values = store.all_values()[rows]
        groups.append(
            ObservationGroup(
                name=f"observed {kind}",
                type=OBSERVED_PARAMETERS[kind],
                blocks=(rows,),
                observed=np.where(np.isfinite(sigma[rows]), values, np.nan),
                sigma=sigma[rows],
                constants=np.zeros((len(rows), 0)),
                references=(tuple(store.ids[i] for i in rows),),
                image_unit=_image_unit(reading, store),
            )
        )
    return groups


def _image_unit(reading: Reading, store: BlockStore) -> str:
    """Image unit of the interior orientations of one kind (of the first camera that has it)."""
    for name, camera in reading.project.cameras.items():
        if INTERIORS[camera.model] is store.kind and name in reading.scales:
            return reading.scales[name].unit
    return "mm"


def level_groups(reading: Reading) -> list[ObservationGroup]:
    """Levels observed as zero tilt, in instrument axes, for the stations whose level has a σ."""
    stations = reading.shop.things["station"]
    groups = []
    for number, table in enumerate(reading.project.stations):
        if table.level in ("fixed", "free"):
            continue
        place = reading.at("stations", number)
        try:
            sigma = reading.edge.number(table.level, ANGLE)
        except UnitError as error:
            reading.problems.append(place.problem(str(error), "level"))
            continue
        if sigma <= 0.0:
            reading.problems.append(place.problem("level: expected a σ > 0, or fixed", "level"))
            continue
        names = reading.table_ids.get(("stations", number), [])
        rows = np.array([stations.part(name, "rotation") for name in names], dtype=np.int64)
        groups.append(
            ObservationGroup(
                name=f"levels {number + 1}",
                type=PLAIN_TYPES["level"],
                blocks=(rows,),
                observed=np.zeros((len(rows), 2)),
                sigma=np.full((len(rows), 2), sigma),
                constants=np.zeros((len(rows), 0)),
                references=(tuple(names),),
            )
        )
    return groups


def variant_groups(reading: Reading, variants: dict[str, dict[int, float]]) -> list[ObservationGroup]:
    """Differences of image-variant components from their camera's, observed as zero where they have a σ."""
    groups = []
    cameras, images = reading.shop.things["camera"], reading.shop.things["image"]
    for number, name in enumerate(cameras.ids):
        sigmas = {k: s for k, s in variants.get(name, {}).items() if np.isfinite(s)}
        if not sigmas:
            continue
        kind = INTERIORS[reading.project.cameras[name].model]
        mine = np.flatnonzero(images.parts["camera"] == number)
        observed = np.full((len(mine), kind.size), np.nan)
        sigma = np.full((len(mine), kind.size), np.nan)
        for component, value in sigmas.items():
            observed[:, component], sigma[:, component] = 0.0, value
        shared = np.full(len(mine), cameras.parts["interior"][number])
        groups.append(
            ObservationGroup(
                name=f"image-variant interior of camera {name}",
                type=OBSERVED_DIFFERENCES[kind.key],
                blocks=(shared, images.parts["interior"][mine]),
                observed=observed,
                sigma=sigma,
                constants=np.zeros((len(mine), 0)),
                references=((f"camera {name}",) * len(mine), tuple(f"image {images.ids[i]}" for i in mine)),
                image_unit=reading.scales[name].unit,
            )
        )
    return groups


def parameter_groups(reading: Reading) -> list[ObservationGroup]:
    """Groups of types ``parameter`` and ``difference``: any component of any block."""
    groups: list[ObservationGroup] = []
    for number, entry in enumerate(reading.project.observations):
        if entry.type not in ("parameter", "difference"):
            continue
        place = reading.at("observations", number)
        names = ("of",) if entry.type == "parameter" else ("from", "to")
        columns = [
            *(Column(name, required=True) for name in names),
            Column("component", required=True),
            Column("value", parse=lambda text, unit: _packed(text), required=entry.type == "parameter"),
            Column("sigma", parse=lambda text, unit: _packed(text), required=True),
        ]
        rows = read_table(entry, columns, place, reading.problems)
        if rows is not None:
            groups += _parameter_rows(reading, entry, rows, names)
    return groups


def _packed(text: str) -> float:
    """Values of parameters have different quantities row by row; they are converted with their component."""
    try:
        return float(text)
    except ValueError:
        raise UnitError(f"found {text!r}, expected a plain number in the unit of its component") from None


def _parameter_rows(
    reading: Reading, entry: Observations, rows: Rows, names: tuple[str, ...]
) -> list[ObservationGroup]:
    collected: dict[str, list[tuple[int, tuple[int, ...], int, float, float]]] = {}
    value, sigma = np.nan_to_num(rows.number("value")), rows.number("sigma")
    for i in range(rows.count):
        found = [_find(reading, rows.text(name)[i], rows.text("component")[i]) for name in names]
        words = next((f for f in found if isinstance(f, str)), None)
        if words is None and len({f[0] for f in found if not isinstance(f, str)}) > 1:
            words = "a difference needs two blocks of the same kind"
        if words is None and len(found) == 2 and found[0] == found[1]:
            words = "a difference needs two different blocks"
        if words is None and not sigma[i] >= 0.0:
            words = f"found σ = {sigma[i]:g}, expected σ ≥ 0"
        if words is not None:
            reading.problems.append(Problem(words, rows.file, int(rows.lines[i])))
            continue
        good = [f for f in found if not isinstance(f, str)]
        kind, _, component = good[0]
        blocks = tuple(f[1] for f in good)
        factor = reading.edge.factor(KINDS[kind].components[component].quantity, "", _scale_of(reading, kind))
        if sigma[i] == 0.0:
            _exactly(reading, kind, blocks, component, value[i] * factor, rows, i)
            continue
        collected.setdefault(kind, []).append((i, blocks, component, value[i] * factor, sigma[i] * factor))
    return [_parameter_group(reading, entry, kind, found, rows, names) for kind, found in collected.items()]


def _find(reading: Reading, name: str, component: str) -> tuple[str, int, int] | str:
    """Kind, block and component number behind ``camera C1`` and ``c``; words where there is none."""
    space, _, bare = name.partition(" ")
    if space not in PARTS:
        return f"found {name!r}, expected one of {', '.join(f'{s} …' for s in PARTS)}{nearest(space, PARTS)}"
    things = reading.shop.things[space]
    if bare not in things.numbers:
        return unknown_name(space, bare, things.ids)
    known: list[str] = []
    for part in PARTS[space]:
        kind = _kind_of_part(reading, space, bare, part)
        known += kind.names
        if component in kind.names:
            return kind.key, things.part(bare, part), kind.names.index(component)
    return f"{name} has no component {component!r}{nearest(component, known)} (known: {', '.join(known)})"


def _kind_of_part(reading: Reading, space: str, name: str, part: str):  # type: ignore[no-untyped-def]
    plain = {"position": "point", "relative rotation": "rotation", "offset": "eccentricity"}
    if part == "interior":
        camera = (
            name
            if space == "camera"
            else reading.shop.things["camera"].ids[reading.shop.things["image"].part(name, "camera")]
        )
        return INTERIORS[reading.project.cameras[camera].model]
    return KINDS[plain.get(part, part)]


def _scale_of(reading: Reading, kind: str):  # type: ignore[no-untyped-def]
    for name, camera in reading.project.cameras.items():
        if INTERIORS[camera.model].key == kind:
            return reading.scales.get(name)
    return None


def _exactly(
    reading: Reading, kind: str, blocks: tuple[int, ...], component: int, value: float, rows: Rows, i: int
) -> None:
    """σ = 0: a parameter is fixed at its value, a zero difference makes two components one."""
    store = reading.shop.store(kind)
    if len(blocks) == 1:
        store.hold(blocks[0], component, value)
    elif value == 0.0 and not store.kind.is_rotation:
        store.shared[blocks[1], component] = store.shared.get((blocks[0], component), blocks[0])
        store.copy(blocks[0], blocks[1], component)
    else:
        words = "σ = 0 of a difference needs the value 0 (and no rotation); give a small σ instead"
        reading.problems.append(Problem(words, rows.file, int(rows.lines[i])))


def _parameter_group(
    reading: Reading,
    entry: Observations,
    kind: str,
    found: list[tuple[int, tuple[int, ...], int, float, float]],
    rows: Rows,
    names: tuple[str, ...],
) -> ObservationGroup:
    type_ = (OBSERVED_PARAMETERS if len(names) == 1 else OBSERVED_DIFFERENCES)[kind]
    size = KINDS[kind].size
    observed, sigma = np.full((len(found), size), np.nan), np.full((len(found), size), np.nan)
    for row, (_, _, component, value, s) in enumerate(found):
        observed[row, component], sigma[row, component] = value, s * entry.factor
    lines: IntArray = np.array([rows.lines[i] for i, *_ in found], dtype=np.int64)
    scale = _scale_of(reading, kind)
    return ObservationGroup(
        name=entry.name or entry.file or entry.type,
        type=type_,
        blocks=tuple(np.array([blocks[k] for _, blocks, *_ in found]) for k in range(len(names))),
        observed=observed,
        sigma=sigma,
        constants=np.zeros((len(found), 0)),
        references=tuple(tuple(rows.text(name)[i] for i, *_ in found) for name in names),
        image_unit=scale.unit if scale else "mm",
        lines=lines,
        file=rows.file,
    )


__all__ = ["level_groups", "parameter_groups", "prior_groups", "variant_groups"]
