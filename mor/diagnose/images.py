"""Image coordinates: y downwards, turned, in another unit; the camera constant, or the size of its pixels, wrong."""

from __future__ import annotations

import re
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import replace
from functools import partial
from operator import sub

import numpy as np

from mor.diagnose.hypothesis import (
    CellEdit,
    Edit,
    Hypothesis,
    KeyEdit,
    Situation,
    cells,
    computed,
    frames_of,
    table_key,
    to,
    with_group,
    with_observed,
)
from mor.model.images import is_image_point
from mor.model.parameters import Values
from mor.project.axes import ImageScale
from mor.project.network import Network
from mor.quality.solution import AddedParameter
from mor.types import BoolArray, FloatArray, IntArray

Change = Callable[[FloatArray], FloatArray]

_IMAGES = 6
"""Images that are looked at, the worst first."""
_MIRRORS = {"image flipped": ((1.0, -1.0), "y"), "image turned": ((-1.0, -1.0), "x, y")}
PRINCIPAL_POINT = ("xp", "yp", "x0", "y0", "cx", "cy", "xh", "yh")


def image_hypotheses(situation: Situation) -> list[Hypothesis]:
    """Other axes or units, of images that do not fit and of cameras."""
    groups = enumerate(situation.network.groups)
    numbers = [k for k, group in groups if is_image_point(group.type)]
    return [*_of_images(situation, numbers), *_of_cameras(situation, numbers)]


def camera_constant_hypotheses(situation: Situation) -> list[Hypothesis]:
    """The camera constants, and the principal points, that are fixed or observed as unknowns."""
    cameras = situation.network.things["camera"].ids if "camera" in situation.network.things else ()
    kinds = (("image scale", ("c", "fx", "fy")), ("pixel origin", PRINCIPAL_POINT))
    return [
        h
        for k, name in enumerate(cameras)
        for cause, among in kinds
        for h in _interior(situation, name, k, cause, among)
    ]


def other_camera_hypotheses(situation: Situation) -> list[Hypothesis]:
    """Images that may be of another camera of the project: each alone, and all together that score tests name."""
    network = situation.network
    if "camera" not in network.things or len(network.things["camera"].ids) < 2:
        return []
    images, cameras = network.things["image"], network.things["camera"]
    sets = [
        tuple(name for name in one.things if name in images.numbers)
        for one in situation.scored
        if one.cause == "camera of images"
    ]
    bad: dict[str, int] = {}
    for group, wrong in zip(network.groups, situation.misfitting, strict=False):
        if is_image_point(group.type):
            for row in np.flatnonzero(wrong.any(axis=1)).tolist():
                bad[group.references[0][row]] = bad.get(group.references[0][row], 0) + 1
    sets += [(name,) for name in sorted(bad, key=lambda name: -bad[name])[:_IMAGES]]
    found = []
    for names in dict.fromkeys(one for one in sets if one):
        own = {int(images.parts["camera"][images.numbers[name]]) for name in names}
        for k, camera in enumerate(cameras.ids):
            models = {network.project.cameras[cameras.ids[j]].model for j in (*own, k)}
            if own != {k} and len(own) == 1 and len(models) == 1:
                edits = tuple(CellEdit(("images",), "camera", to(camera), cells={"id": name}) for name in names)
                found.append(
                    Hypothesis(
                        "camera of images",
                        (*names, camera),
                        partial(_of_camera, names=names, camera=k),
                        "; ".join(f"images, {name}: camera: {camera}" for name in names),
                        len(images.ids) * len(cameras.ids),
                        edits=edits,
                        afresh=True,
                    )
                )
    return found


def _of_camera(network: Network, names: Sequence[str], camera: int) -> Network:
    cameras = network.things["camera"]
    for number, group in enumerate(network.groups):
        if not is_image_point(group.type):
            continue
        chosen = np.isin(np.asarray(group.references[0]), names)
        slots = [k for k, s in enumerate(group.type.slots) if s.part == "interior"]
        blocks = [
            np.where(chosen, cameras.parts["interior"][camera], own) if k in slots else own
            for k, own in enumerate(group.blocks)
        ]
        network = with_group(network, number, replace(group, blocks=tuple(blocks)))
    return network


def _of_images(situation: Situation, numbers: list[int]) -> Iterator[Hypothesis]:
    """Single images, those that the start values speak against first; where most are bad, it is none of them."""
    parts: dict[str, list[tuple[int, IntArray]]] = {}
    bad: dict[str, tuple[int, int]] = {}
    for number in numbers:
        rows_bad: BoolArray = np.asarray((situation.sizes[number] > situation.limit).any(axis=1))
        for name, rows in situation.network.groups[number].references[0].rows_of_each().items():
            parts.setdefault(name, []).append((number, rows))
            before = bad.get(name, (0, 0))
            bad[name] = before[0] + int(rows_bad[rows].sum()), before[1] + len(rows)
    shares = {name: wrong / count for name, (wrong, count) in bad.items() if count >= 3}
    # Part of the rays of an image that do not fit, from which on it is looked at.
    worst = sorted((n for n in shares if shares[n] >= 0.5), key=lambda n: -shares[n])
    against = _against_start_values(situation.network, parts)
    named = [names for names in (worst, against) if 2 * len(names) <= len(parts)]
    for name in dict.fromkeys(name for names in reversed(named) for name in names[:_IMAGES]):
        for cause, (signs, axes) in _MIRRORS.items():
            yield _mirrored(situation, cause, (name,), parts[name], signs, f"image {name}: −{axes}", True, len(bad))


def _against_start_values(network: Network, parts: Mapping[str, Sequence[tuple[int, IntArray]]]) -> list[str]:
    """Images whose rays come nearer to their start values mirrored or turned, the clearest first."""
    gains, every = {}, ((1.0, 1.0), *(signs for signs, _ in _MIRRORS.values()))
    numbers = {number for rows in parts.values() for number, _ in rows}
    beside = {number: [_beside(network, number, signs) for signs in every] for number in numbers}
    for name, rows in parts.items():
        plain, *others = np.sum([[own[chosen].sum() for own in beside[number]] for number, chosen in rows], axis=0)
        gains[name] = float(plain - min(others))
    # Σ ln by which the start values have to speak for other signs: odds of a million to one, if they were that good.
    clear = [name for name, gain in gains.items() if gain > 14.0]
    return sorted(clear, key=lambda name: -gains[name])


def _beside(network: Network, number: int, signs: tuple[float, float]) -> FloatArray:
    """(n,) Σ ln |v|/σ of each ray at the given start values, its coordinates with other signs."""
    group = network.groups[number]
    blocks = [network.start[slot.kind][own] for slot, own in group.blocks_by_slot]
    with np.errstate(all="ignore"):
        computed = group.type.equation(blocks, group.constants).values
        logs = np.log(np.fmax(np.abs(group.observed * np.array(signs) - computed) / group.given_sigma, 1.0))
    return np.asarray(np.where(np.isfinite(logs), logs, 0.0).sum(axis=1))


def _of_cameras(situation: Situation, numbers: list[int]) -> Iterator[Hypothesis]:
    network = situation.network
    cameras, images = network.things["camera"], network.things["image"]
    for k, name in enumerate(cameras.ids):
        mine = {images.ids[i] for i in np.flatnonzero(images.parts["camera"] == k)}
        parts = []
        for number in numbers:
            names = network.groups[number].references[0]
            rows = np.flatnonzero(np.array([n in mine for n in names.known], dtype=bool)[names.numbers])
            if len(rows):
                parts.append((number, rows))
        if not parts:
            continue
        other = "centred" if network.project.cameras[name].coordinates == "corner" else "corner"
        line = f"cameras, {name}: coordinates: {other} (y)"
        yield _mirrored(situation, "image flipped", (name,), parts, (1.0, -1.0), line, False, len(cameras.ids))
        yield from _units(situation, name, parts)


def _mirrored(
    situation: Situation,
    cause: str,
    things: tuple[str, ...],
    parts: list[tuple[int, IntArray]],
    signs: tuple[float, float],
    line: str,
    local: bool,
    candidates: int,
) -> Hypothesis:
    def change(network: Network) -> Network:
        for number, rows in parts:
            network = with_observed(network, number, rows, lambda xy: xy * np.array(signs))
        return network

    groups = situation.network.groups
    recomputed = frames_of((groups[number], rows) for number, rows in parts) if local else {}
    few = sum(len(rows) for _, rows in parts) <= 10_000  # rows that a diff may change one by one
    edits = _mirrored_cells(situation.network, parts, signs) if few else ()
    return Hypothesis(cause, things, change, line, candidates, recomputed=recomputed, afresh=not local, edits=edits)


def _mirrored_cells(
    network: Network, parts: list[tuple[int, IntArray]], signs: tuple[float, float]
) -> tuple[Edit, ...]:
    """Edits that mirror coordinates: about 0, or about the middle of images whose coordinates begin in a corner."""
    images, cameras = network.things["image"], network.things["camera"]
    edits: list[Edit] = []
    for number, rows in parts:
        group = network.groups[number]
        for row in rows.tolist():
            scale = network.scales[cameras.ids[images.parts["camera"][images.numbers[group.references[0][row]]]]]
            for axis, name in enumerate("xy"):
                if signs[axis] < 0.0:
                    whole = 2.0 * float(scale.centre[axis]) if scale.corner else 0.0
                    edits += cells(network, number, [row], name, computed(partial(sub, whole)))
    return tuple(edits)


def _units(situation: Situation, name: str, parts: list[tuple[int, IntArray]]) -> Iterator[Hypothesis]:
    scale = situation.network.scales[name]
    count = sum(int(np.count_nonzero(situation.network.groups[k].mask[rows])) for k, rows in parts)
    table = situation.network.groups[parts[0][0]].name
    for words, change in _readings(scale).items():
        stretch = count * float(np.log(np.abs(np.diff(change(np.array([[0.0, 0.0], [1.0, 1.0]])), axis=0)[0, 0])))

        def changed(network: Network, change: Change = change) -> Network:
            for number, rows in parts:
                network = with_observed(network, number, rows, change)
            return network

        unit = words.partition(" ")[0]
        line = f"observations, {table}: units: {{x: {unit}, y: {unit}}}"
        (number, rows), *others = parts
        alone = not others and len(rows) == situation.network.groups[number].count
        edits = table_key(situation.network, number, "units", f"{{x: {unit}, y: {unit}}}") if alone else ()
        yield Hypothesis("image unit", (name, words), changed, line, 4, stretch=stretch, afresh=True, edits=edits)


def _readings(scale: ImageScale) -> dict[str, Change]:
    """Image coordinates (k, 2) as if they had been read in another unit."""
    if scale.corner:
        down = np.array([1.0, -1.0])
        middle = np.array(scale.centre)

        def again(xy: FloatArray, unit: float) -> FloatArray:
            given = middle + down * xy / scale.pixel  # the numbers as they stand in the table
            return np.asarray(down * (given * unit - middle * scale.pixel))

        return {"mm for px": lambda xy: again(xy, 1.0), "um for px": lambda xy: again(xy, 0.001)}
    factors = {"um for mm": 0.001, "m for mm": 1000.0, "cm for mm": 10.0}
    if np.isfinite(scale.pixel):
        factors["px for mm"] = scale.pixel
    return {words: partial(np.multiply, factor) for words, factor in factors.items()}


def _interior(situation: Situation, name: str, camera: int, cause: str, among: tuple[str, ...]) -> Iterator[Hypothesis]:
    """Some components of the interior orientation as unknowns, if they are fixed or observed.

    An observed one costs its observation already.
    """
    network = situation.network
    model = network.project.cameras[name].model
    kind = f"interior/{model}"
    block = int(network.things["camera"].parts["interior"][camera])
    names = network.blocks[kind].kind.names
    columns = [k for k, own in enumerate(names) if own in among]
    held = [k for k in columns if not network.blocks[kind].free[block, k] or _is_observed(network, kind, block, k)]
    if not held:
        return

    def change(changed: Network) -> Network:
        blocks = changed.blocks[kind]
        free = blocks.free.copy()
        free[block, held] = True
        changed = replace(changed, blocks={**changed.blocks, kind: blocks._replace(free=free)})
        for number, group in enumerate(changed.groups):
            if group.type.key == f"observed/{kind}":
                observed: FloatArray = group.observed.copy()
                observed[np.flatnonzero(group.blocks[0] == block)[:, None], held] = np.nan
                changed = with_group(changed, number, replace(group, observed=observed))
        return changed

    def amount(values: Values) -> AddedParameter:
        return AddedParameter(names[held[0]], float(values[kind][block, held[0]]))

    yield Hypothesis(
        cause,
        (name,),
        change,
        f"cameras, {name}: interior: {{{names[held[0]]}: {{free: …}}}}",
        len(network.things["camera"].ids),
        parameters=sum(not _is_observed(network, kind, block, k) for k in held),
        edits=tuple(KeyEdit(("cameras", name, "interior", names[k]), _set_free) for k in held),
        amount=amount,
    )


def _set_free(old: str, _amount: AddedParameter | None) -> str | None:
    number = re.match(r"\{?\s*(?:\w+:)?\s*([-+.\deE]+)", old)
    return f"{{free: {number[1]}}}" if number else None


def _is_observed(network: Network, kind: str, block: int, component: int) -> bool:
    return bool(np.isfinite(network.sigma[kind][block, component]))
