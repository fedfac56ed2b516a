"""Score tests of the usual mistakes at the solution: no further adjustment is made.

A mistake adds p parameters x to the observation equations, l + v = f(X) + B x. B holds the derivatives of the computed
observations with respect to x, or the change of the observations by a definite mistake (another sign, an exchanged
name), for which x = 1. With the residuals v, their weights P and their cofactors Q_vv the Lagrange multiplier test is

    T = gᵀ M⁻¹ g,    g = −BᵀPv,    M = BᵀPQ_vvPB,    x̂ = M⁻¹ g

(C. R. Rao 1948; W. Baarda 1968 for one parameter). T is the decrease of vᵀPv to first order, and is χ² with p degrees
of freedom if there is no such mistake. A definite mistake decreases vᵀPv by 2g − M.
"""

from __future__ import annotations

from collections.abc import Collection, Iterable, Iterator, Sequence
from dataclasses import replace
from itertools import combinations, pairwise
from typing import TYPE_CHECKING, NamedTuple

import numpy as np

from mor.diagnose.angles import middle_of
from mor.diagnose.control import DISTANCE, HORIZONTAL_DISTANCE, other_kind, unit_factor
from mor.diagnose.heights import HeightRows, given_height, height_sights
from mor.diagnose.hypothesis import OBSERVED_POINTS
from mor.diagnose.images import PRINCIPAL_POINT
from mor.diagnose.names import ROWS, Match, matches, where, with_the_same_names, wrong_name
from mor.model import rotations
from mor.model.contract import ObservationGroup, wrap
from mor.model.curvature import on_sphere
from mor.model.images import is_image_point
from mor.model.observation_types import PLAIN_TYPES
from mor.model.parameters import Values
from mor.project.network import Network
from mor.quality.assessment import Quality, assess
from mor.quality.external_reliability import FEW_POINTS, WhitenedRows, sparse_matrix, whitened_rows
from mor.quality.global_tests import factor_of_group, fits_factor
from mor.quality.outliers import SuspectedOutliers, cost_of_choice, with_suspects
from mor.quality.plausibility import NOTED, beyond_reach, largest_effect, sphere_under, usual_height
from mor.quality.redundancy import Reliability
from mor.quality.solution import AddedParameter, ScoredHypothesis
from mor.quality.test_statistics import CONTROLLED, LEVEL, log_p_chi2
from mor.solve.iterate import Outcome, SolverSettings, adjust
from mor.solve.problem import Problem, evaluated, linearise, misclosures, rotation_tangents
from mor.types import BoolArray, FloatArray, IntArray

if TYPE_CHECKING:
    from scipy.sparse import csc_array

_ENTRIES = 20_000_000
"""Numbers (unknowns times parameters) that are held at a time."""
_PAIRS = 12
"""Flagged rows of a station or image of which all pairs are looked at, the worst first."""
_OF_SEVERAL = ("levelling sign", "vector sign", "face", "camera of images", "antenna height", "control moved")
"""Causes of which several may have come together: the same person, the same day."""
_JOINED = 12
"""Mistakes of one kind that are joined to one cause; if there are as many, the cause is another one."""

_THINGS = 30
"""Images or stations in which mistakes of their own are looked for, those with the largest squares of flagged w."""

_ALMOST = 0.9
"""Part of what another mistake explains that is almost as much: a definite mistake is not linear."""


class _Candidate(NamedTuple):
    """A mistake as columns beside the observation equations."""

    cause: str
    things: tuple[str, ...]
    line: str
    parts: tuple[tuple[int, IntArray, FloatArray], ...]
    """(group, rows (k,), derivatives (k, m, p)) of the observations it changes."""
    definite: bool = False
    """True if x is 1."""
    amount: tuple[str, float] | None = None
    """Name of the parameter and its present value, if it is reported."""
    ratio: float | None = None
    """Factor between the observations as they may be meant and as they were read, for a table in another unit."""

    @property
    def parameters(self) -> int:
        return int(self.parts[0][2].shape[2])

    @property
    def rows(self) -> int:
        return sum(len(rows) for _, rows, _ in self.parts)


class _Scored(NamedTuple):
    candidate: _Candidate
    x: FloatArray
    gain: float
    """Decrease of vᵀPv to first order."""
    length: float
    """Gain less the cost of the choice of the candidate and of its parameters."""
    log_p: float
    freedom: int
    """Number of its parameters; of several mistakes together that of all."""


def score_tests(
    quality: Quality, network: Network, doubtful: Sequence[BoolArray] | None = None
) -> tuple[ScoredHypothesis, ...]:
    """Return up to three mistakes that would explain what the tests of an adjustment reject, the best first.

    They are possible causes, not verified ones. A mistake is named if its test rejects at the family-wise level
    ``LEVEL`` and it explains more than the worst single observation does, or as much with one parameter, or almost as
    much with none: a definite mistake is not linear.
    ``doubtful`` are the rows (n,) of each group that single mistakes are looked for in; by default those that the
    tests of single observations flag.
    """
    problem, values = quality.adjustment.problem, quality.adjustment.values
    flagged = doubtful or [np.asarray(flags.any(axis=1)) for flags in quality.flagged]
    candidates = list(_candidates(problem, network, values, quality, flagged))
    if not candidates:
        return ()
    count = len(candidates)
    limit = float(np.log(LEVEL / count))
    worst, least = _single(quality)
    enough = {False: least, True: _ALMOST * least}
    scored = [one for some in _chunks(candidates, quality) for one in _scores(quality, some, count)]
    good = [one for one in scored if one.length > enough[one.freedom == 0] or (one.freedom == 1 and one.gain >= worst)]
    joined, too_many = _joined(quality, candidates, count)
    good = [one for one in good if one.candidate.cause not in too_many]
    good += [one for one in (*joined, *_sigmas(quality)) if one.length > least]
    return _causes([one for one in good if one.log_p < limit])


def score_tests_with_suspects(
    quality: Quality, network: Network, suspects: SuspectedOutliers
) -> tuple[ScoredHypothesis, ...]:
    """Return the mistakes that would explain the suspects which an adjustment leaves out, the best first.

    A definite mistake is tried on the misclosures at the solution without the suspects. If none explains them, all
    observations are in the normal equations there, and their residuals are those after one linear step: no further
    adjustment is made. Returns nothing if points or images were given up together with the suspects.
    """
    if suspects.lost:
        return ()
    problem, masks = with_suspects(quality.adjustment.problem, suspects)
    here = adjust(problem, quality.adjustment.values, SolverSettings(0))
    if here.outcome is Outcome.SINGULAR:
        return ()
    doubtful = [np.asarray((mask | flags).any(axis=1)) for mask, flags in zip(masks, quality.flagged, strict=True)]
    of_all = assess(here, quality.levels, aposteriori=False)
    return _explaining(of_all, network, doubtful, masks) or score_tests(_after_step(of_all), network, doubtful)


def _explaining(
    quality: Quality, network: Network, doubtful: Sequence[BoolArray], suspects: Sequence[BoolArray]
) -> tuple[ScoredHypothesis, ...]:
    """Definite mistakes in most of the suspects (n, m) of each group that explain nearly all of their misclosures.

    If none does alone, several of one kind in different rows count together.
    """
    problem, values = quality.adjustment.problem, quality.adjustment.values
    candidates = [one for one in _candidates(problem, network, values, quality, doubtful) if one.definite]
    cost = cost_of_choice(problem.observations, len(candidates), 0, 0.0)
    most = sum(int(np.count_nonzero(mask)) for mask in suspects) // 2
    found: list[_Scored] = []
    in_part: dict[str, list[_Scored]] = {}
    for one in candidates:
        before, after, rows = 0.0, 0.0, 0
        for number, own, change in one.parts:
            group = problem.groups[number]
            used = group.used_among(own)
            plain, sigma = misclosures(group, values, own), group.sigma[own]
            before += float(np.sum(((plain / sigma)[used]) ** 2))
            after += float(np.sum((((plain - change[:, :, 0]) / sigma)[used]) ** 2))
            rows += int(np.count_nonzero(suspects[number][own]))
        # Part of the squares of misclosures that a mistake may leave: their size then falls to a tenth.
        if after <= 0.01 * before and rows:
            gain = before - after
            scored = _Scored(one, np.ones(1), gain, gain - cost, float(log_p_chi2(gain, 1)), 0)
            if rows > most:
                found.append(scored)
            else:
                in_part.setdefault(one.cause, []).append(scored)
    for some in [] if found else [in_part[cause] for cause in _OF_SEVERAL if cause in in_part]:
        together = _together(_apart(some))
        if sum(int(np.count_nonzero(suspects[k][own])) for k, own, _ in together.candidate.parts) > most:
            found.append(together)
    return _causes(found)


def _apart(some: Sequence[_Scored]) -> list[_Scored]:
    """Mistakes that have no row in common, those that gain most first."""
    taken: set[tuple[int, int]] = set()
    chosen = []
    for one in sorted(some, key=lambda other: -other.gain):
        rows = {(number, row) for number, own, _ in one.candidate.parts for row in own.tolist()}
        if not rows & taken:
            chosen.append(one)
            taken |= rows
    return chosen


def _together(chosen: Sequence[_Scored]) -> _Scored:
    """Several mistakes of one kind as one cause."""
    parts = tuple(part for one in chosen for part in one.candidate.parts)
    things = tuple(dict.fromkeys(name for one in chosen for name in one.candidate.things))
    lines = "; ".join(one.candidate.line for one in chosen)
    together = chosen[0].candidate._replace(things=things, line=lines, parts=parts, amount=None)
    gain = sum(one.gain for one in chosen)
    freedom = sum(0 if one.candidate.definite else one.candidate.parameters for one in chosen)
    log_p, length = float(log_p_chi2(gain, max(freedom, 1))), sum(one.length for one in chosen)
    return _Scored(together, np.zeros(0), gain, length, log_p, freedom)


def _after_step(quality: Quality) -> Quality:
    """The quality with the residuals that one linear step leaves."""
    adjustment = quality.adjustment
    index, values = adjustment.problem.index, adjustment.values
    step, tangent = adjustment.inverse.step(adjustment.normals), rotation_tangents(index, values)
    groups = []
    for group, one in zip(adjustment.problem.groups, quality.groups, strict=True):
        part = linearise(group, index, values, tangent, slice(None))
        moved = np.where(part.columns >= 0, step[part.columns], 0.0)
        v = np.einsum("nmk,nk->nm", part.jacobian, moved) - part.misclosure
        groups.append(replace(one, v=np.where(group.mask, v, np.nan)))
    reliability = tuple(Reliability(one, quality.noncentrality) for one in groups)
    return replace(quality, groups=tuple(groups), reliability=reliability)


def _candidates(
    problem: Problem, network: Network, values: Values, quality: Quality, flagged: Sequence[BoolArray]
) -> Iterator[_Candidate]:
    adjusted = [number for number, group in enumerate(problem.groups) if not group.left_out.all()]
    for number in adjusted:
        group = problem.groups[number]
        yield from _instruments(problem, values, number, group)
        worst = list(_worst(quality, number, flagged[number]))
        yield from _interiors(problem, network, values, number, group, worst)
        yield from _observed_interiors(network, number, group, flagged[number])
        yield from _signs(number, group, flagged[number])
        yield from _units(number, group)
        yield from _circles(values, number, group)
        yield from _faces(values, number, group, flagged[number])
        yield from _turned_circles(values, number, group, flagged[number])
        yield from _exchanges(values, number, group, quality, flagged[number], worst)
    yield from _wrong_names(network, values, quality, flagged)
    yield from _set_ups(problem, network, values, adjusted, flagged)
    yield from _heights(problem, network, values, quality)
    yield from _antennas(problem, values, adjusted)
    yield from _control(problem, network, values, adjusted, flagged, quality)
    yield from _curvature(problem, network, values, adjusted)


class _Sights(NamedTuple):
    """Rows (k,) of an image or a station."""

    name: str
    rows: IntArray


def _worst(quality: Quality, number: int, flagged: BoolArray) -> Iterator[_Sights]:
    """Yield the images or stations with the largest Σ w² of flagged rows, in the order of these rows."""
    rows, names = np.flatnonzero(flagged), quality.adjustment.problem.groups[number].references[0]
    own = names.numbers[rows]
    squares = np.bincount(own, weights=_largest(quality, number, rows) ** 2)
    chosen = set(np.argsort(-squares, kind="stable")[:_THINGS].tolist())
    for one in dict.fromkeys(own.tolist()):
        if one in chosen:
            yield _Sights(names.known[one], np.flatnonzero(names.numbers == one))


def _largest(quality: Quality, number: int, rows: IntArray) -> FloatArray:
    """Return the largest |w| (k,) of each of these rows of a group."""
    tests = np.nan_to_num(np.abs(quality.reliability[number].at(rows).test))
    return np.asarray(tests.max(axis=1, initial=0.0))


def _slot_columns(
    group: ObservationGroup, values: Values, rows: IntArray, slot: int, components: Sequence[int]
) -> FloatArray:
    return np.asarray(np.nan_to_num(evaluated(group, values, rows).jacobians[slot][:, :, list(components)]))


def _instruments(problem: Problem, values: Values, number: int, group: ObservationGroup) -> Iterator[_Candidate]:
    slots = [k for k, slot in enumerate(group.type.slots) if slot.kind == "distance meter"]
    if not slots or group.count < 3:
        return
    free = problem.index.blocks["distance meter"].free[group.blocks[slots[0]]]
    rows = np.arange(group.count)
    for name, component in (("scale", 0), ("offset", 1)):
        if free[:, component].any():
            continue
        columns = _slot_columns(group, values, rows, slots[0], [component])
        edm = f"{{edm: {{{name}: {{free: {1 - component}}}}}}}"
        line = f"instruments: {edm}; observations, {group.name}: instrument: edm"
        present = float(values["distance meter"][group.blocks[slots[0]][0], component])
        yield _Candidate(f"distance {name}", (group.name,), line, ((number, rows, columns),), amount=(name, present))
    if group.type not in (DISTANCE, HORIZONTAL_DISTANCE):
        return
    cause, other, line = other_kind(group)
    change = _change(group, values, rows, evaluated(other, values, rows).values)
    yield _Candidate(cause, (group.name,), line, ((number, rows, change[:, :, None]),), definite=True)


def _interiors(
    problem: Problem,
    network: Network,
    values: Values,
    number: int,
    group: ObservationGroup,
    worst: Sequence[_Sights],
) -> Iterator[_Candidate]:
    slots = [k for k, slot in enumerate(group.type.slots) if slot.part == "interior"]
    if not slots or not is_image_point(group.type):
        return
    slot, kind = slots[0], group.type.slots[slots[0]].kind
    names = problem.index.blocks[kind].kind.names
    constant = [k for k, name in enumerate(names) if name in ("c", "fx", "fy")]
    principal = [k for k, name in enumerate(names) if name in PRINCIPAL_POINT]
    images, cameras = network.things["image"], network.things["camera"]
    camera_of = dict(zip(cameras.parts["interior"].tolist(), cameras.ids, strict=True))
    blocks = np.asarray(group.blocks[slot])
    for block in np.unique(blocks).tolist():
        rows, name = np.flatnonzero(blocks == block), camera_of.get(block, "")
        free = problem.index.blocks[kind].free[block]
        for cause, components, key in (
            ("image scale", constant, names[constant[0]] if constant else ""),
            ("pixel origin", principal, names[principal[0]] if principal else ""),
        ):
            held = [k for k in components if not free[k]]
            if held:
                columns = _slot_columns(group, values, rows, slot, held)
                if cause == "image scale":
                    columns = columns.sum(axis=2, keepdims=True)
                line = f"cameras, {name}: interior: {{{key}: {{free: …}}}}"
                amount = (key, float(values[kind][block, held[0]])) if cause == "image scale" else None
                yield _Candidate(cause, (name,), line, ((number, rows, columns),), amount=amount)
    if not constant or len(images.ids) < 2:
        return
    for image, rows in worst:
        columns = _slot_columns(group, values, rows, slot, constant).sum(axis=2, keepdims=True)
        yield _Candidate("camera of images", (image,), f"images, {image}: camera: …", ((number, rows, columns),))
        # With a camera for each image there is nothing to take the wrong one from.
        for other, name in camera_of.items() if 2 * len(camera_of) <= len(images.ids) else ():
            if other != blocks[rows[0]] and other < len(values[kind]):
                change = _with_blocks(group, values, rows, {slot: np.full(len(rows), other)})
                line = f"images, {image}: camera: {name}"
                part = (number, rows, change[:, :, None])
                yield _Candidate("camera of images", (image, name), line, (part,), True)


def _observed_interiors(
    network: Network, number: int, group: ObservationGroup, flagged: BoolArray
) -> Iterator[_Candidate]:
    if not group.type.key.startswith("observed/interior"):
        return
    cameras = network.things["camera"]
    camera_of = dict(zip(cameras.parts["interior"].tolist(), cameras.ids, strict=True))
    names = [component.name for component in group.type.components]
    for row, k in np.argwhere(flagged[:, None] & group.used).tolist():
        name, key = camera_of.get(int(group.blocks[0][row]), ""), names[k]
        if not name or key not in ("c", "fx", "fy", *PRINCIPAL_POINT):
            continue
        unit = np.zeros((1, len(names), 1))
        unit[0, k] = -1.0
        cause = "pixel origin" if key in PRINCIPAL_POINT else "image scale"
        line = f"cameras, {name}: interior: {{{key}: {{free: …}}}}"
        amount = (key, float(group.observed[row, k])) if cause == "image scale" else None
        part = (number, np.array([row]), unit)
        yield _Candidate(cause, (name,), line, (part,), amount=amount)


def _signs(number: int, group: ObservationGroup, flagged: BoolArray) -> Iterator[_Candidate]:
    if not group.type.between_marks or len(group.references) != 2:
        return
    for row in np.flatnonzero(flagged & ~group.left_out.any(axis=1)).tolist():
        names = tuple(column[row] for column in group.references[:2])
        rows = np.array([row])
        change = 2.0 * np.nan_to_num(group.observed[rows])[:, :, None]
        line = f"{where(group, row)}: {names[1]} → {names[0]}"
        cause = "levelling sign" if len(group.type.components) == 1 else "vector sign"
        yield _Candidate(cause, names, line, ((number, rows, change),), definite=True)


def _with_blocks(group: ObservationGroup, values: Values, rows: IntArray, blocks: dict[int, IntArray]) -> FloatArray:
    """(k, m) by how much the computed observations of some rows change with other blocks in some slots."""
    numbers = [blocks.get(k, np.asarray(own[rows])) for k, own in enumerate(group.blocks)]
    given = [values[slot.kind][own] for slot, own in zip(group.type.slots, numbers, strict=True)]
    return _change(group, values, rows, group.type.equation(given, group.constants[rows]).values)


def _change(group: ObservationGroup, values: Values, rows: IntArray, computed: FloatArray) -> FloatArray:
    """(k, m) what some rows are computed to otherwise, less what they are; 0 where that has no value."""
    change = computed - evaluated(group, values, rows).values
    change[:, group.type.wraps] = wrap(change[:, group.type.wraps])
    return np.asarray(np.nan_to_num(change))


def _units(number: int, group: ObservationGroup) -> Iterator[_Candidate]:
    """Another unit of all lengths of a table; control in another unit is far from anything linear."""
    lengths = [c.quantity.length == 1 and not is_image_point(group.type) for c in group.type.components]
    if not any(lengths) or group.count < 2 or not group.type.distances:
        return
    rows = np.arange(group.count)
    # Factors from the numbers as they were read to the numbers as they may be meant; their inverses as well.
    factors = {"ft for m": 0.3048, "mm for m": 0.001, "cm for m": 0.01}
    for name, factor in factors.items():
        for words, ratio in ((name, factor), (" for ".join(reversed(name.split(" for "))), 1.0 / factor)):
            change = -(ratio - 1.0) * np.where(lengths, np.nan_to_num(group.observed), 0.0)[:, :, None]
            line = f"observations, {group.name}: units: {words.split()[0]}"
            yield _Candidate("table unit", (group.name, words), line, ((number, rows, change),), True, ratio=ratio)


def _circles(values: Values, number: int, group: ObservationGroup) -> Iterator[_Candidate]:
    """Sense and unit of a circle, zenith angles that are elevations: of the table and of each of its stations."""
    if not group.type.wraps.any() or group.type.distances is None:
        return
    stations = group.references[0].rows_of_each()
    sets: list[tuple[tuple[str, ...], IntArray]] = [((name, group.name), rows) for name, rows in stations.items()]
    if len(sets) > 1:
        sets.append(((group.name,), np.arange(group.count)))
    names = [c.name for c in group.type.components]
    zenith = [k for k, name in enumerate(names) if name in ("zenith", "zenith_angle")]
    angles = np.flatnonzero(group.type.wraps).tolist()
    for things, rows in sets:
        observed = np.nan_to_num(group.observed[rows])
        changes: list[tuple[str, tuple[str, ...], str, FloatArray]] = []
        if group.type.turns and len(rows) > 1:
            other = observed.copy()
            other[:, group.type.turns[0]] *= -1.0
            changes.append(("circle sense", things, f"observations, {things[0]}: axes: {{angles: …}}", other))
        if zenith:
            other = observed.copy()
            other[:, zenith] = 0.5 * np.pi - observed[:, zenith]
            changes.append(("elevation for zenith", things, f"observations, {things[0]}: type: directions", other))
        for unit, factor in _angle_units(observed[:, angles]):
            other = observed.copy()
            other[:, angles] *= factor
            changes.append(("circle unit", (*things, unit), f"observations, {things[0]}: units: {unit}", other))
        for cause, about, line, other in changes:
            part = (number, rows, _read_otherwise(values, group, rows, other)[:, :, None])
            yield _Candidate(cause, about, line, (part,), True)


def _angle_units(angles: FloatArray) -> Iterator[tuple[str, float]]:
    """Units that angles (k, m) in radians may have been given in, with the factor from the unit they were read in."""
    largest = float(np.abs(angles).max(initial=0.0))
    for unit, factor in (("deg", 400.0 / 360.0), ("gon", 360.0 / 400.0)):
        if factor * largest <= 2.0 * np.pi:
            yield unit, factor


def _read_otherwise(values: Values, group: ObservationGroup, rows: IntArray, other: FloatArray) -> FloatArray:
    """(k, m) change of the computed observations that has the effect of other observed values (k, m) of some rows.

    The orientation of each set of horizontal directions follows.
    """
    plain = np.nan_to_num(misclosures(group, values, rows))
    moved = plain + other - np.nan_to_num(group.observed[rows])
    for column in np.flatnonzero(group.type.wraps).tolist():
        if column in group.type.turns and group.type.references[0].name == "station":
            for own in group.references[0].take(rows).rows_of_each().values():
                moved[own, column] -= middle_of(moved[own, column])
        moved[:, column] = wrap(moved[:, column])
    return np.asarray(plain - moved)


def _faces(values: Values, number: int, group: ObservationGroup, flagged: BoolArray) -> Iterator[_Candidate]:
    if not group.type.turns or group.type.references[0].name != "station":
        return
    column = group.type.turns[0]
    rows = np.flatnonzero(flagged)
    plain = np.nan_to_num(misclosures(group, values, rows))[:, column]
    for row, size in zip(rows.tolist(), plain.tolist(), strict=True):
        if abs(size) < 0.05:  # rad; from there on the rest of half a circle may be in the orientation
            continue
        change = np.zeros((1, group.observed.shape[1], 1))
        change[0, column, 0] = np.pi * np.sign(size)
        names = tuple(column_[row] for column_ in group.references[:2])
        line = f"{where(group, row)}: horizontal + 200 gon"
        yield _Candidate("face", names, line, ((number, np.array([row]), change),), True)


def _turned_circles(values: Values, number: int, group: ObservationGroup, flagged: BoolArray) -> Iterator[_Candidate]:
    """Sets whose circle was turned between two of their rows: another orientation from there on."""
    if not group.type.turns or group.type.references[0].name != "station":
        return
    column, stations = group.type.turns[0], np.asarray(group.references[0])
    shares = {name: int(flagged[stations == name].sum()) for name in dict.fromkeys(stations[flagged].tolist())}
    least = 2  # directions before and after a circle was turned
    for name in sorted(shares, key=lambda one: -shares[one])[:_PAIRS]:
        rows = np.flatnonzero(stations == name)
        places = range(least, len(rows) - least + 1)
        if len(places) > 12:  # those with the largest steps of the misclosures
            size = np.abs(np.diff(np.nan_to_num(misclosures(group, values, rows))[:, column]))
            best = np.argsort(-size[least - 1 : len(rows) - least], kind="stable")
            places = (best[:12] + least).tolist()
        for place in places:
            turned = rows[place:]
            unit = np.zeros((len(turned), group.observed.shape[1], 1))
            unit[:, column, 0] = 1.0
            yield _Candidate(
                "orientation changed",
                (name, group.references[1][int(turned[0])]),
                f"{where(group, int(turned[0]))}: a set of its own from here on",
                ((number, turned, unit),),
            )


def _exchanges(
    values: Values,
    number: int,
    group: ObservationGroup,
    quality: Quality,
    flagged: BoolArray,
    worst: Sequence[_Sights],
) -> Iterator[_Candidate]:
    if len(group.references) != 2 or group.type.between_marks:
        return
    target = group.type.references[-1].name
    slots = [k for k, slot in enumerate(group.type.slots) if slot.of == target]
    for frame, rows in worst:
        here = rows[flagged[rows]]
        here = here[np.argsort(-_largest(quality, number, here), kind="stable")][:_PAIRS]
        pairs = np.array(list(combinations(here.tolist(), 2))).reshape(-1, 2)
        if not len(pairs):
            continue
        rows = pairs.ravel()
        partner = pairs[:, ::-1].ravel()
        change = _with_blocks(group, values, rows, {k: np.asarray(group.blocks[k][partner]) for k in slots})
        for k, pair in enumerate(pairs):
            names = [group.references[-1][int(row)] for row in pair]
            if names[0] == names[1]:
                continue
            line = f"{where(group, int(pair[0]))}: {names[1]}; {where(group, int(pair[1]))}: {names[0]}"
            part = (number, pair, change[2 * k : 2 * k + 2, :, None])
            yield _Candidate("names exchanged", (frame, *sorted(names)), line, (part,), definite=True)


def _wrong_names(
    network: Network, values: Values, quality: Quality, flagged: Sequence[BoolArray]
) -> Iterator[_Candidate]:
    found: list[Match] = []
    names = max((len(things.ids) for things in network.things.values()), default=1)
    # Names that are tried for the rows of a table: 20 000 in small networks, and in larger ones as many as there are
    # observations, up to two million; for one row in any case.
    most = min(ROWS, max(min(max(20_000, network.observations), 2_000_000) // max(names, 1), 1))
    for number, group in enumerate(network.groups):
        if len(group.references) < 2 or group.type.between_marks:
            continue
        rows = np.flatnonzero(flagged[number])
        for row in rows[np.argsort(-_largest(quality, number, rows), kind="stable")[:most]].tolist():
            found += matches(network, values, number, row)
    for same in with_the_same_names(found):
        cause, things, line = wrong_name(network, same)
        parts = []
        for one in same:
            row = np.array([one.row])
            blocks = {slot: np.array([block]) for slot, block in one.blocks.items()}
            change = _with_blocks(network.groups[one.group], values, row, blocks)
            parts.append((one.group, row, change[:, :, None]))
        yield _Candidate(cause, things, line, tuple(parts), definite=True)


def _set_ups(
    problem: Problem, network: Network, values: Values, adjusted: Sequence[int], flagged: Sequence[BoolArray]
) -> Iterator[_Candidate]:
    """Pairs of stations whose places were exchanged: each instrument stood where the other one is said to stand."""
    declared = set(network.things["station"].ids) if "station" in network.things else set()
    sights: dict[str, list[tuple[int, int, IntArray]]] = {}
    doubtful: dict[str, int] = {}
    for number in adjusted:
        group = problem.groups[number]
        if group.type.distances is None or group.type.between_marks:
            continue
        begin = group.type.distances[0]
        slots = [k for k, s in enumerate(group.type.slots) if s.of == begin and s.part == "position"]
        for name, rows in group.column(begin).rows_of_each().items() if slots else ():
            if name in declared:
                sights.setdefault(name, []).append((number, slots[0], rows))
                doubtful[name] = doubtful.get(name, 0) + int(flagged[number][rows].sum())
    suspected = sorted((n for n in doubtful if doubtful[n]), key=lambda n: -doubtful[n])[:_PAIRS]
    pairs = {tuple(sorted((a, b))) for a in suspected for b in sights if a != b}
    ordered = sorted(pairs, key=lambda pair: (-sum(doubtful[n] for n in pair), pair))[: _PAIRS**2]
    for pair in ordered:
        places = [int(problem.groups[k].blocks[slot][rows[0]]) for k, slot, rows in (sights[n][0] for n in pair)]
        if places[0] == places[1]:
            continue
        parts = []
        for name, other in zip(pair, reversed(places), strict=True):
            for number, slot, rows in sights[name]:
                group = problem.groups[number]
                moved = _with_blocks(group, values, rows, {slot: np.full(len(rows), other)})
                change = _read_otherwise(values, group, rows, np.nan_to_num(group.observed[rows]) - moved)
                parts.append((number, rows, change[:, :, None]))
        line = f"stations: {pair[0]} ↔ {pair[1]}"
        yield _Candidate("set-ups exchanged", pair, line, tuple(parts), True)
        own = {(number, slot) for name in pair for number, slot, _ in sights[name]}
        others = _of_exchanged_points(problem, values, adjusted, (places[0], places[1]), own)
        if others:  # the same, if the points have moved to where their instruments stood
            yield _Candidate("set-ups exchanged", pair, line, others, True)


def _of_exchanged_points(
    problem: Problem,
    values: Values,
    adjusted: Sequence[int],
    pair: tuple[int, int],
    but: Collection[tuple[int, int]] = (),
) -> tuple[tuple[int, IntArray, FloatArray], ...]:
    """Parts of a candidate that exchanges two points (block numbers) in all rows, but for some (group, slot)."""
    parts = []
    for number in adjusted:
        group = problem.groups[number]
        blocks = {}
        for slot, own in enumerate(group.type.slots):
            if own.kind == "point" and (number, slot) not in but:
                was = np.asarray(group.blocks[slot])
                now = np.where(was == pair[0], pair[1], np.where(was == pair[1], pair[0], was))
                if (now != was).any():
                    blocks[slot] = now
        if blocks:
            changed = [blocks[slot] != np.asarray(group.blocks[slot]) for slot in blocks]
            rows = np.flatnonzero(np.any(changed, axis=0))
            change = _with_blocks(group, values, rows, {slot: now[rows] for slot, now in blocks.items()})
            parts.append((number, rows, change[:, :, None]))
    return tuple(parts)


def _heights(problem: Problem, network: Network, values: Values, quality: Quality) -> Iterator[_Candidate]:
    if "height" not in problem.index.blocks:
        return
    controlled = [np.nan_to_num(group.r).max(axis=1, initial=0.0) > CONTROLLED for group in quality.groups]
    for one in height_sights(network):
        if any(rows[-1] >= problem.groups[number].count for number, rows, _ in one.rows):
            continue
        if not any(controlled[number][rows].any() for number, rows, _ in one.rows):
            continue
        parts = tuple(
            (number, rows, _slot_columns(problem.groups[number], values, rows, slot, [0]))
            for number, rows, slot in one.rows
        )
        yield _Candidate(one.cause, one.things, one.line, parts, amount=("height", given_height(network, one)))
    beyond = beyond_reach(network)
    usual = {**values, "height": np.where(beyond[:, None], usual_height(network), values["height"])}
    for one in height_sights(network) if beyond.any() else ():
        number, rows, slot = one.rows[0]
        if len(one.things) == 1 and beyond[network.groups[number].blocks[slot][rows]].all():
            yield _Candidate(one.cause, one.things, one.line, tuple(_instead(problem, values, usual, one)), True)


def _instead(
    problem: Problem, values: Values, usual: Values, one: HeightRows
) -> Iterator[tuple[int, IntArray, FloatArray]]:
    for number, rows, _ in one.rows:
        group = problem.groups[number]
        yield number, rows, _change(group, values, rows, evaluated(group, usual, rows).values)[:, :, None]


def _antennas(problem: Problem, values: Values, adjusted: Sequence[int]) -> Iterator[_Candidate]:
    numbers = [k for k in adjusted if problem.groups[k].type == PLAIN_TYPES["vector"]]
    points = {name for k in numbers for column in problem.groups[k].references[:2] for name in column}
    for name in sorted(points):
        parts = []
        for k in numbers:
            group = problem.groups[k]
            for slot, own in enumerate(group.type.slots):
                if own.part != "position":
                    continue
                rows = np.flatnonzero([n == name for n in group.column(own.of)])
                if len(rows):
                    parts.append((k, rows, _slot_columns(group, values, rows, slot, [2])))
        line = f"observations, vectors at {name}: antenna height"
        yield _Candidate("antenna height", (name,), line, tuple(parts), amount=("height", 0.0))


def _control(
    problem: Problem,
    network: Network,
    values: Values,
    adjusted: Sequence[int],
    flagged: Sequence[BoolArray],
    quality: Quality,
) -> Iterator[_Candidate]:
    """Control points with wrong coordinates, and pairs of them, or of images with observed places, exchanged."""
    ids = problem.index.blocks["point"].ids
    images = network.things["image"]
    image_at = dict(zip(images.parts["position"].tolist(), images.ids, strict=True))
    for k in adjusted:
        group = problem.groups[k]
        if group.type.key not in OBSERVED_POINTS:
            continue
        points = np.asarray(group.blocks[0])
        for row in np.flatnonzero(flagged[k]).tolist():
            seen = np.flatnonzero(group.mask[row] & ~group.left_out[row])
            name = ids[points[row]]
            line = f"points, {name}: x, y, z"
            tests = np.abs(quality.reliability[k].at(np.array([row])).test[0])
            for some in (seen, seen[np.argsort(-tests[seen])[:1]]):
                unit = np.zeros((1, group.observed.shape[1], len(some)))
                unit[0, some, np.arange(len(some))] = 1.0
                part = (k, np.array([row]), unit)
                yield _Candidate("control moved", (name,), line, (part,))
        rows = np.flatnonzero(flagged[k] & group.mask.all(axis=1))
        sizes = np.nan_to_num(np.abs(quality.reliability[k].at(rows).test)).max(axis=1, initial=0.0)
        rows = rows[np.argsort(-sizes, kind="stable")[:_PAIRS]]
        for pair in combinations(rows.tolist(), 2):
            one, other = np.array(pair)
            change = group.observed[[one, other]] - group.observed[[other, one]]
            cause, of, names = "control exchanged", "points", (ids[points[one]], ids[points[other]])
            if points[one] in image_at and points[other] in image_at:
                cause, of, names = ("images exchanged", "images", (image_at[points[one]], image_at[points[other]]))
            yield _Candidate(
                cause,
                names,
                f"{of}: {names[0]} ↔ {names[1]}",
                ((k, np.array(pair), change[:, :, None]),),
                definite=True,
            )
    free = problem.index.blocks["point"].free
    fixed: dict[int, list[tuple[int, IntArray, FloatArray]]] = {}
    for k in adjusted:
        group = problem.groups[k]
        for slot, own in enumerate(group.type.slots):
            if own.kind != "point" or own.part != "position":
                continue
            blocks = np.asarray(group.blocks[slot])
            doubtful = np.unique(blocks[flagged[k]])
            for point in doubtful[~free[doubtful].any(axis=1)].tolist():
                rows = np.flatnonzero(blocks == point)
                fixed.setdefault(point, []).append((k, rows, _slot_columns(group, values, rows, slot, (0, 1, 2))))
    for pair in combinations(list(fixed)[:_PAIRS], 2):
        change_parts = _of_exchanged_points(problem, values, adjusted, pair)
        names = (ids[pair[0]], ids[pair[1]])
        line = f"points: {names[0]} ↔ {names[1]}"

        yield _Candidate("control exchanged", names, line, change_parts, True)
    for point, parts in fixed.items():
        yield _Candidate("control moved", (ids[point],), f"points, {ids[point]}: x, y, z", tuple(parts))


def _curvature(problem: Problem, network: Network, values: Values, adjusted: Sequence[int]) -> Iterator[_Candidate]:
    effect = largest_effect(network, values)
    if effect is None or effect.in_sigma < NOTED:
        return
    sphere, parts = sphere_under(network, values), []
    for k in adjusted:
        group = problem.groups[k]
        bent = replace(group, type=on_sphere(group.type, sphere, network.edge.metres))
        if bent.type is group.type:
            continue
        rows = np.arange(group.count)
        parts.append((k, rows, _change(group, values, rows, evaluated(bent, values, rows).values)[:, :, None]))
    if parts:
        yield _Candidate("curvature", (), "curvature: true", tuple(parts), definite=True)


def _chunks(candidates: Sequence[_Candidate], quality: Quality) -> Iterator[list[_Candidate]]:
    """Candidates together as far as the solutions for their columns fit into memory.

    They have the unknowns of the reduced system if there are few rows, for few points are eliminated then.
    """
    adjustment = quality.adjustment
    unknowns, reduced = max(adjustment.problem.index.count, 1), max(len(adjustment.plan.kept), 1)
    chunk: list[_Candidate] = []
    width = rows = 0
    for one in candidates:
        width, rows = width + one.parameters, rows + one.rows
        if chunk and width * (reduced if rows <= FEW_POINTS else unknowns) > _ENTRIES:
            yield chunk
            chunk, width, rows = [], one.parameters, one.rows
        chunk.append(one)
    if chunk:
        yield chunk


class _Columns(NamedTuple):
    """Columns Z = W B of some candidates, side by side."""

    slices: list[slice]
    """Those of each candidate."""
    Z: csc_array
    """(N, P)."""
    squares: FloatArray
    """(P,) the diagonal of BᵀPB = ZᵀZ."""
    right: FloatArray
    solved: FloatArray
    """(l, P) both, with the product BᵀPA Q AᵀPB."""
    g: FloatArray
    """(P,) −BᵀPv."""

    def multipliers(self, some: slice) -> FloatArray:
        """M (p, p)."""
        Z = self.Z[:, some]
        return np.asarray((Z.T @ Z).toarray() - self.right[:, some].T @ self.solved[:, some])


def _columns(quality: Quality, candidates: Sequence[_Candidate]) -> _Columns:
    rows = _rows(quality, candidates)
    ends = np.cumsum([0, *(one.parameters for one in candidates)])
    entries = []
    for one, first in zip(candidates, ends[:-1], strict=True):
        for number, own, derivatives in one.parts:
            place = np.broadcast_to(rows.places[number][own][:, :, None], derivatives.shape)
            column = np.broadcast_to(first + np.arange(one.parameters), derivatives.shape)
            used = (place >= 0) & (derivatives != 0.0)
            entries.append((place[used], column[used], derivatives[used]))
    Z = (rows.whitening @ sparse_matrix(entries, (rows.design.shape[0], int(ends[-1])))).tocsc()
    residuals = rows.whitened([np.nan_to_num(one.v) for one in quality.groups])
    right, solved = rows.system.factors((rows.design.T @ Z).tocsr())
    slices = [slice(first, end) for first, end in pairwise(ends.tolist())]
    return _Columns(slices, Z, Z.power(2).sum(axis=0), right, solved, -(Z.T @ residuals))


def _scores(quality: Quality, candidates: Sequence[_Candidate], count: int) -> list[_Scored]:
    found, columns = [], _columns(quality, candidates)
    alone = columns.squares - np.einsum("cp,cp->p", columns.right, columns.solved)
    for one, mine in zip(candidates, columns.slices, strict=True):
        M = columns.multipliers(mine) if one.parameters > 1 else alone[mine, None]
        scored = _score(quality, one, columns.g[mine], M, columns.squares[mine], count)
        if scored is not None:
            found.append(scored)
    return found


def _score(
    quality: Quality, one: _Candidate, g: FloatArray, M: FloatArray, squares: FloatArray, count: int
) -> _Scored | None:
    """Score from g (p,), M (p, p), and the diagonal ``squares`` (p,) of BᵀPB."""
    size = np.sqrt(np.maximum(squares, 1e-300))
    scaled = rotations.eigvalsh(M / np.outer(size, size))
    if not np.isfinite(M).all() or not squares.all() or scaled[0] <= CONTROLLED:
        return None
    # Without a scale of its own the network follows the unit: residuals change by the same factor, and say nothing.
    if one.ratio is not None and abs(M[0, 0] - (1.0 - one.ratio) * g[0]) < 0.1 * one.ratio * abs(g[0]):
        return None
    if one.definite:
        x = np.ones(1)
        gain = float(2.0 * g[0] - M[0, 0])
    else:
        x = np.asarray(rotations.solve(M, g))
        gain = float(g @ x)
        name, present = one.amount or ("", 0.0)
        # Metres that no prism constant, and no height of an instrument, target or antenna exceeds.
        if abs(present + float(x[0])) > {"offset": 0.5, "height": 10.0}.get(name, np.inf):
            return None
    if gain <= 0.0:
        return None
    parameters = 0 if one.definite else one.parameters
    cost = cost_of_choice(quality.adjustment.problem.observations, count, parameters, 0.0)
    return _Scored(one, x, gain, gain - cost, float(log_p_chi2(gain, one.parameters)), parameters)


def _rows(quality: Quality, candidates: Iterable[_Candidate]) -> WhitenedRows:
    chosen = [np.zeros(group.observed.shape, dtype=bool) for group in quality.adjustment.problem.groups]
    for one in candidates:
        for number, rows, _ in one.parts:
            chosen[number][rows] = True
    for cluster in quality.adjustment.plan.clusters:
        places = list(zip(cluster.groups, cluster.rows, cluster.components, strict=True))
        if any(chosen[g][r, c] for g, r, c in places):
            for g, r, c in places:
                chosen[g][r, c] = True
    groups = quality.adjustment.problem.groups
    used = [mask & group.used for mask, group in zip(chosen, groups, strict=True)]
    return whitened_rows(quality, used)


def _single(quality: Quality) -> tuple[float, float]:
    """Gain and length of the worst single observation; the gain less its round-off."""
    largest = max(
        (float(np.nanmax(np.abs(one.at(slice(None)).test), initial=0.0)) for one in quality.reliability), default=0.0
    )
    observations = quality.adjustment.problem.observations
    length = largest**2 - cost_of_choice(observations, observations, 1, 0.0)
    return (1.0 - 1e-6) * largest**2, max(length, 0.0)


def sigma_tests(quality: Quality) -> tuple[ScoredHypothesis, ...]:
    """Return up to three tables whose σ is in too large a unit, for a network whose residuals are too small."""
    return _causes([one for one in _sigmas(quality, smaller=True) if one.length > 0.0 and one.log_p < np.log(LEVEL)])


def _sigmas(quality: Quality, smaller: bool = False) -> Iterator[_Scored]:
    """Tables whose residuals are normal with another σ: −2 ln of how likely they are falls by r (q − 1 − ln q).

    q = Ω/r is the variance factor of the table, r its redundancy. Not if there is but one table: then the global test
    says the same. ``smaller`` asks for q < 1 instead of q > 1, and only as far as another unit explains.
    """
    groups = quality.adjustment.problem.groups
    tested = [k for k, group in enumerate(groups) if not group.left_out.all() and group.count > 1]
    for k in tested:
        r = float(np.nansum(quality.groups[k].r))
        omega = float(np.nansum(quality.groups[k].v * quality.groups[k].weighted))
        factor = factor_of_group(quality, k)
        # Redundancy of a table from which on its σ is judged.
        if r < 5.0 or (omega <= r) != smaller or factor is None:
            continue
        q = omega / r
        unit = unit_factor(float(np.sqrt(q)))
        # Only another unit, such as that of their σ, makes residuals far too small.
        if unit is None if smaller else len(tested) == 1 or not fits_factor(quality, k, factor):
            continue
        likelihood = r * (q - 1.0 - float(np.log(q)))
        rows = np.flatnonzero(groups[k].mask.any(axis=1))
        one = _Candidate(
            "sigma unit" if unit else "sigma of a table",
            (groups[k].name,),
            f"observations, {groups[k].name}: factor: {unit or np.sqrt(q):.3g}",
            ((k, rows, np.zeros((len(rows), groups[k].observed.shape[1], 1))),),
            amount=("sigma factor", 0.0),
        )
        cost = cost_of_choice(quality.adjustment.problem.observations, len(tested), 1, 0.0)
        log_p = float(log_p_chi2(likelihood, 1))
        yield _Scored(one, np.array([np.sqrt(q)]), omega - r, likelihood - cost, log_p, 1)


def _joined(quality: Quality, candidates: Sequence[_Candidate], count: int) -> tuple[list[_Scored], set[str]]:
    """Mistakes of one kind together: one after the other, as long as each shortens the description.

    With them the causes of which there would be too many: something else looks like them.
    """
    found: list[_Scored] = []
    too_many: set[str] = set()
    for cause in _OF_SEVERAL:
        some = [one for one in candidates if one.cause == cause]
        if len(some) < 2 or len(some) * quality.adjustment.problem.index.count > _ENTRIES:
            continue
        chosen = _greedy(quality, some, count)
        if len(chosen) == _JOINED:
            too_many.add(cause)
        elif len(chosen) > 1:
            found.append(_together(chosen))
    return found, too_many


def _greedy(quality: Quality, some: Sequence[_Candidate], count: int) -> list[_Scored]:
    """The candidates that gain most, each beside those chosen before it."""
    columns = _columns(quality, some)
    M, g = columns.multipliers(slice(None)), columns.g.copy()
    chosen: list[_Scored] = []
    left = list(range(len(some)))
    while left and len(chosen) < _JOINED:
        scores = {}
        for k in left:
            mine = columns.slices[k]
            scores[k] = _score(quality, some[k], g[mine], M[mine, mine], columns.squares[mine], count)
        best = max(left, key=lambda k: _told_apart(one.length) if (one := scores[k]) is not None else -np.inf)
        one, own = scores[best], columns.slices[best]
        # Part of the gain of mistakes of one kind below which another one explains second-order terms of the others.
        if one is None or one.length <= 0.0 or one.gain < 0.02 * sum(other.gain for other in chosen):
            break
        chosen.append(one)
        left.remove(best)
        g -= M[:, own] @ one.x
        if not some[best].definite:  # its parameters are estimated together with those of the others
            M -= M[:, own] @ rotations.solve(M[own, own], M[own])
    return chosen


def _told_apart(length: float) -> float:
    """Description length without round-off, so that what cannot be told apart stays in the order of the causes."""
    return float(f"{length:.9g}")


def _distinct(good: Sequence[_Scored]) -> list[_Scored]:
    """The best first, without those that explain a part of what a better one of the same kind explains.

    One with a few parameters less that explains almost as much comes first.
    """
    found: list[_Scored] = []
    best = max((one.length for one in good), default=0.0)

    def rank(one: _Scored) -> tuple[bool, float, float]:
        alike = one.length >= _ALMOST * best
        return not alike, float(one.freedom) if alike else 0.0, -_told_apart(one.length)

    for one in sorted(good, key=rank):
        inside = any(
            one.candidate.cause == other.candidate.cause
            and (
                set(one.candidate.things) <= set(other.candidate.things)
                # Causes of which one for each table is enough.
                or (
                    one.candidate.cause in ("table unit", "circle unit")
                    and one.candidate.things[0] == other.candidate.things[0]
                )
            )
            for other in found
        )
        if not inside:
            found.append(one)
    return found


def _causes(found: Sequence[_Scored]) -> tuple[ScoredHypothesis, ...]:
    return tuple(_cause(one) for one in _distinct(found)[:3])


def _cause(one: _Scored) -> ScoredHypothesis:
    candidate, amount = one.candidate, None
    if candidate.amount is not None and not candidate.definite:
        name, present = candidate.amount
        amount = AddedParameter(name, present + float(one.x[0]))
    rows = [(number, row) for number, own, _ in candidate.parts for row in own.tolist()]
    components = {k for _, _, change in candidate.parts for k in np.flatnonzero(change.any(axis=(0, 2))).tolist()}
    return ScoredHypothesis(
        candidate.cause,
        candidate.things,
        candidate.line,
        one.gain,
        one.freedom,
        float(one.log_p / np.log(10.0)),
        amount,
        # Rows of a possible cause that are handed on.
        tuple(rows) if len(rows) <= 1000 else (),
        tuple(sorted(components)),
    )
