"""The way from a project file to results."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import replace
from functools import partial
from pathlib import Path
from typing import NamedTuple

import numpy as np

from mor.diagnose.hypothesis import NOTHING_FOUND, Diagnosis, GoOn
from mor.errors import InputError, Message, NoStartValuesError, UndeterminedObject, mistakes_in
from mor.input_files import is_folder, note_input, read_text, standard_input
from mor.linalg.cholesky import NotFiniteError, one_thread
from mor.linalg.compilation import chosen_by_size
from mor.model.contract import with_sigma_model, without
from mor.model.coordinates import target_slot
from mor.model.images import is_image_point
from mor.model.parameters import ROTATION, Values, all_known, index_unknowns, with_shared_components
from mor.project.document import Document, read_yaml
from mor.project.entities import TableWatcher, ignore_table, thing_of
from mor.project.network import Network, build_network, with_blocks_held
from mor.project.planned_network import read_out_at
from mor.project.schema import Settings as ProjectSettings
from mor.project.schema import validate, without_empty_keys
from mor.project.tables import MOST_TOLD
from mor.quality.assessment import BEYOND_USE, Levels, Quality, assess, checked, points_far_off
from mor.quality.determinability import (
    Means,
    adjust_determinable,
    completed,
    fits,
    with_fitting_reason,
    with_nearer_datum,
    without_hanging,
    without_moved,
    without_unknown,
)
from mor.quality.group_tests import Rejection, group_tests, rejection
from mor.quality.outliers import (
    Attempt,
    SuspectedOutliers,
    frames_far_off,
    left_out,
    lost_blocks,
    may_be_absurd,
    without_suspects,
)
from mor.quality.plausibility import implausible, neglected_curvature
from mor.quality.redundancy import Done, effort
from mor.quality.snooping import put_back
from mor.quality.solution import ScoredHypothesis, Solved, TreatmentOptions, treat, with_poses
from mor.quality.test_statistics import critical_value
from mor.solve.datum import beside
from mor.solve.iterate import Adjustment, Outcome, Patience, SolverSettings, Watcher, adjust, counting_on
from mor.solve.problem import CorrelatedObservations, DatumDefinition, Problem, undefined_rows
from mor.start.part import Approximation
from mor.types import BoolArray, FloatArray

# ---- From a network to its adjustment problem: start values, unknowns numbered, observations with their σ.
#
# Start values are worked out where none are given; of several that are possible the adjustment decides.


def make_problem(network: Network, start: Mapping[str, FloatArray], place: Mapping[str, FloatArray]) -> Problem:
    """The adjustment problem of a network: unknowns numbered, correlations and datum set, σ models evaluated.

    The datum refers to the given coordinates, and to those of ``start`` for points without. Distances in σ models, and
    times by which rows are read out on trajectories, are those of ``place``.
    """
    groups, checks = (
        tuple(with_sigma_model(read_out_at(network, group, place), place) for group in some)
        for some in (network.groups, network.checks)
    )
    groups += tuple(without(group, group.mask) for group in checks)
    offsets = np.concatenate([[0], np.cumsum([group.observed.size for group in groups])])
    widths = np.array([group.observed.shape[1] for group in groups])
    clusters = tuple(
        CorrelatedObservations(offsets[c.groups] + c.rows * widths[c.groups] + c.components, c.covariance)
        for c in network.correlations
    )
    reference = {"point": network.datum.reference_from(start["point"])}
    movements = reference if network.datum.at_reference else None
    datum = DatumDefinition(network.datum.name, network.datum.free, {"point": network.datum.mask}, reference, movements)
    return Problem(index_unknowns(network.blocks), groups, clusters, datum)


def determinable_start(
    network: Network, work_out: Callable[[Network], Approximation] | None = None
) -> tuple[Network, Mapping[str, FloatArray]]:
    """The network and start values of all blocks, worked out where none are given (:func:`worked_out`).

    Points at infinity stay without coordinates. What nobody could start is left out where the project wants that;
    otherwise it raises :class:`NoStartValuesError`.
    """
    if network.trajectories:
        from mor.start.along_trajectories import along_trajectories

        network = along_trajectories(network)
    if network.project.settings.undetermined == "leave_out":
        network = without_hanging(network)
    if all_known(network.start):
        return _over_its_places(network, network.start)
    # Imported here: its libraries take as long to load as a small project to adjust.
    from mor.start.part import with_lines_turned

    found = (work_out or worked_out)(network)
    replaced = tuple(Message(f"start value of {words}; it was replaced") for words in found.replaced)
    ambiguous = tuple(
        Message(
            f"start values: the part that began with {join.began} fits in {join.tie.alternatives + 1} ways; "
            "the most likely one is used"
        )
        for join in found.parts
        if join.tie is not None and join.tie.alternatives and not join.tie.open
    )
    untied = tuple(
        Message(
            f"start values: the part that began with {join.began} ({len(join.points)} points) has an arbitrary "
            "position: nothing was found that ties it to the rest"
        )
        for join in found.untied
    )
    network = replace(network, notes=(*network.notes, *replaced, *ambiguous), untied=untied)
    settings = network.project.settings
    start: Mapping[str, FloatArray]
    network, start = with_lines_turned(network, found.start)
    start, missing = completed(network, start, found.missing, critical_value(settings.snooping_level))
    if missing and settings.undetermined == "refuse":
        raise NoStartValuesError(missing, map(str, found.remarks))
    if missing:
        network = without_unknown(network, start, missing)
        start = network.start
    return _over_its_places(network, with_shared_components(network.blocks, start))


def _over_its_places(network: Network, start: Mapping[str, FloatArray]) -> tuple[Network, Mapping[str, FloatArray]]:
    if network.world is None:
        return network, start
    from mor.project.planned_network import with_planes_over  # most projects need nothing of it

    return with_planes_over(network, start), start


def worked_out(network: Network) -> Approximation:
    """Start values worked out; of several that are possible those that the adjustment agrees with best."""
    from mor.start.assembly import approximate

    return approximate(network, partial(_settled, network))


def _settled(network: Network, start: Mapping[str, FloatArray]) -> tuple[Mapping[str, FloatArray], float] | None:
    """Values to which start values lead and their v'Pv, infinite if singular; ``None`` if they lead nowhere."""
    from mor.start.part import with_lines_turned

    network, start = with_lines_turned(network, start)
    start, _ = completed(network, start, (), critical_value(network.project.settings.snooping_level))
    start = with_shared_components(network.blocks, start)
    if not all_known(start):
        return None
    try:
        # Start values in doubt have 40 iterations; they lead nowhere if twelve lower vᵀPv by less than a hundredth.
        found = adjust(make_problem(network, start, start), start, SolverSettings(40, Patience(6, 1e-2, 1e-2)))
    except NotFiniteError:
        return None
    if found.outcome is Outcome.SINGULAR:
        return found.values, np.inf
    return (found.values, found.normals.objective) if found.outcome.is_solution else None


def _worked_out_once(network: Network) -> Approximation:
    """Start values of a change that is only tried: of a wrong one no answer agrees, and all would be asked for."""
    from mor.start.assembly import approximate

    return approximate(network, others=False)


def start_or_nothing(network: Network) -> Mapping[str, FloatArray] | None:
    """Start values of a changed network; nothing if there are none, or where it is no more as large."""
    try:
        reduced, start = determinable_start(network, _worked_out_once)
    except (InputError, NoStartValuesError):
        return None
    sizes = [group.count for group in reduced.groups]
    return start if sizes == [group.count for group in network.groups] else None


# ---- The story of an adjustment: one call for every arrow.
#
# project file → Project → Network → Problem + start values → Adjustment → Quality → Report


def read_document(path: Path, form: str = "") -> Document:
    """Plain data of a project file, or of a file in a foreign format, with lines.

    ``form`` names the foreign format; else the content of the file tells it. The tables that it names are noted as
    inputs. Raises :class:`InputError`.
    """
    note_input(path)
    document = _document(path, form)
    for name in document.table_files():
        note_input(path.parent / name)
    return document


def _document(path: Path, form: str) -> Document:
    if form or is_folder(path) or path.suffix.lower() not in (".yaml", ".yml"):
        from mor.formats import is_foreign, read_foreign  # no project file waits for the formats of others

        if form or is_folder(path) or is_foreign(path):
            return read_foreign(path, form)
    present = path.is_file() or standard_input(path) is not None
    if (
        path.suffix.lower() not in (".yaml", ".yml", ".csv", ".parquet")
        and present
        and not any(line.startswith("mor:") for line in read_text(path, errors="replace").splitlines())
    ):
        return read_foreign(path)
    if path.suffix.lower() in (".csv", ".parquet") and path.is_file():
        words = "this is a table, expected a project file; mor new begins one from tables"
        raise InputError([Message(words, str(path))])
    return without_empty_keys(read_yaml(read_text(path), str(path)))


def read_network(document: Document, folder: Path, read: TableWatcher = ignore_table) -> Network:
    """The network a project describes; its tables are found from ``folder``. Raises :class:`InputError`.

    Its notes say what was assumed, and which observations cannot be right or contradict what is known.
    ``read`` is told each table of points, images and observations that has been read.
    """
    network = build_network(validate(document), document, folder, read)
    return replace(network, notes=(*network.notes, *implausible(network)))


def solve_network(
    network: Network, watch: Watcher | None = None, assessing: Callable[[int], Done] | None = None
) -> Solved:
    """Adjust a network and assess the outcome.

    ``assessing`` is called between the two with the effort ahead; what it returns is told how much more is done.
    """
    with chosen_by_size(network.observations, times_as_long(network)), mistakes_in(network.file):
        return with_poses(_assessed(_adjusted(network, watch), assessing))


def times_as_long(network: Network) -> int:
    """Return how many times as long as in an aerial block (some eight rays to a point) it takes to eliminate points."""
    rays = np.zeros(len(network.blocks["point"].ids))
    for group in network.groups:
        if is_image_point(group.type):
            rays += np.bincount(group.blocks[target_slot(group.type)], minlength=len(rays))
    return max(1, int(rays @ rays / max(8.0 * rays.sum(), 1.0)))


def diagnose_network(network: Network, go_on: GoOn, watch: Watcher | None = None) -> tuple[Solved | None, Diagnosis]:
    """Adjust a network, and search for mistakes if it has no solution or its solution is rejected.

    ``go_on`` is called before each trial and ends the search if it returns False. There is no adjustment if start
    values cannot be found.
    """
    with (
        chosen_by_size(network.observations, times_as_long(network)),
        mistakes_in(network.file),
        np.errstate(all="ignore"),
    ):
        try:
            adjusted = _adjusted(network, watch)
        except NoStartValuesError as error:
            from mor.diagnose.search import causes_without_start

            names = {thing.name for thing in error.things}
            return None, causes_without_start(network, names, make_problem, start_or_nothing, go_on)
        solved = _assessed(adjusted, None)
        return with_poses(solved), _diagnosis(adjusted, solved, go_on)


class _Adjusted(NamedTuple):
    """A network with its start values and its adjustment."""

    whole: Network
    start: Mapping[str, FloatArray]
    network: Network
    """The network without what cannot be determined or was left out."""
    attempt: Attempt


def _adjusted(network: Network, watch: Watcher | None) -> _Adjusted:
    found = _from_start_values(network, watch)
    ended = found.attempt.adjustment
    if (ended.outcome.is_solution and found.attempt.suspects is None) or not ended.iterations:
        return found
    anew = _without_poses(network)
    start = None if anew is None else start_or_nothing(anew)
    if anew is None or start is None:
        return found
    other = _from_start_values(replace(anew, start=start), watch, plainly=True)
    sound = other.attempt.adjustment.outcome is Outcome.CONVERGED and not may_be_absurd(other.attempt.adjustment)
    return other if sound else found


def _without_poses(network: Network) -> Network | None:
    """The network without the start poses of a few images that are far off; ``None`` where there are none to drop."""
    if "rotation" not in network.start or not all_known(network.start):
        return None
    far = frames_far_off(make_problem(network, network.start, network.start), network.start)
    images, start = network.things["image"].parts, dict(network.start)
    off = (images["rotation"] >= 0) & far[images["rotation"]]
    for kind, part in (("rotation", "rotation"), ("point", "position")):
        blocks = images[part][off & (images[part] >= 0)]
        known = ~network.blocks[kind].free[blocks] | np.isfinite(network.sigma[kind][blocks])
        start[kind] = start[kind].copy()
        start[kind][blocks[~known.any(axis=1)]] = np.nan
    if all_known(start):
        return None
    poses_anew = "the start values lead to no solution; poses of images that were far off were computed anew"
    return replace(network, start=start, notes=(*network.notes, Message(poses_anew)))


def _from_start_values(network: Network, watch: Watcher | None, plainly: bool = False) -> _Adjusted:
    with np.errstate(all="ignore"):  # what is not finite is seen in the normal matrix, and told
        with one_thread():
            whole, start = determinable_start(network)
        means = Means(
            _problem_at,
            (lambda some, values: Attempt(_plainly(some, values, watch)))
            if plainly
            else (lambda some, values: _attempt(some, values, watch, values["point"] is start["point"])),
            lambda some, values: Attempt(_plainly(some, values, watch)),
            critical_value(network.project.settings.snooping_level),
        )
        network, attempt = adjust_determinable(whole, start, means)
    adjustment, notes = attempt.adjustment, []
    left = sum(thing.kind == "image" and thing.treatment == "left out" for thing in whole.undeterminable)
    if not adjustment.outcome.is_solution and 2 * left > len(whole.things["image"].ids):
        raise NoStartValuesError(whole.undeterminable, [])
    if attempt.note:
        notes.append(Message(attempt.note))
    bent = neglected_curvature(network, adjustment.values if adjustment.outcome.is_solution else start)
    if bent is not None:
        notes.append(bent)
    if not adjustment.outcome.is_solution:
        notes += network.untied
    network = replace(network, notes=(*network.notes, *notes))
    if attempt.suspects is not None:
        # Blocks that only suspects observe are held and named as left out.
        things = [
            UndeterminedObject(*thing, "its observations contradict each other or the rest", "left out")
            for thing in dict.fromkeys(thing_of(*block) for block in attempt.suspects.lost)
        ]
        marked = {kind: lost_blocks(blocks, kind, attempt.suspects.lost) for kind, blocks in network.blocks.items()}
        network = with_blocks_held(network, marked, things)
    return _Adjusted(whole, start, network, attempt)


def _problem_at(network: Network, values: Mapping[str, FloatArray]) -> Problem:
    return make_problem(network, values, values)


def _attempt(
    network: Network, start: Mapping[str, FloatArray], watch: Watcher | None, is_first: bool = False
) -> Attempt:
    """Adjust from the start values; if they do not lead to a solution, repair them, or leave suspects out.

    Only the ``is_first`` of several attempts asks whether the cameras are determined at all.
    """
    plain = _plainly(network, start, watch)
    weak = _too_weak(plain, levels(network.project.settings)) if is_first else None
    if weak is not None and weak.defect.is_of_cameras:
        return Attempt(weak)
    if len(plain.gone):
        return Attempt(plain)
    settings = SolverSettings(network.project.settings.max_iterations)
    found = without_suspects(plain, settings, counting_on(watch, len(plain.iterations)))
    if found.adjustment is plain:
        return found
    return found._replace(adjustment=_with_settled_sigma(network, found.adjustment, watch, found.suspects))


def _plainly(network: Network, start: Mapping[str, FloatArray], watch: Watcher | None) -> Adjustment:
    problem = make_problem(network, start, start)
    settings = SolverSettings(network.project.settings.max_iterations, gone=True)
    try:
        adjustment = adjust(problem, start, settings, watch)
    except NotFiniteError:
        try:
            there, points = beside(problem, start)["point"], start["point"].copy()
            for group in problem.groups:
                rows = undefined_rows(group, problem.index, start)
                for numbers in group.blocks_of("point"):
                    points[numbers[rows]] = there[numbers[rows]]
            adjustment = adjust(problem, {**start, "point": points}, settings, watch)
        except NotFiniteError:
            raise InputError(_undefined(problem, start)) from None
    return _with_settled_sigma(network, adjustment, watch)


def _assessed(adjusted: _Adjusted, assessing: Callable[[int], Done] | None) -> Solved:
    network, adjustment, suspects = adjusted.network, adjusted.attempt.adjustment, adjusted.attempt.suspects
    settings = network.project.settings
    if not adjustment.outcome.is_solution:
        known = any(not thing.treatment for thing in network.undeterminable)  # then the reason is certain
        if not known:
            adjustment = with_fitting_reason(adjustment, bool(network.untied))
            adjustment = _too_weak(adjustment, levels(settings)) or adjustment
        return Solved(network, adjustment, None, possible_causes=_other_readings(adjusted))
    check_minimal(network, adjustment)
    done = assessing(effort(adjustment)) if assessing is not None else None
    aposteriori = settings.sigma == "aposteriori"
    quality = assess(adjustment, levels(settings), aposteriori, done)
    sound = checked(quality)
    if not sound.outcome.is_solution:
        rest = None
        if sound.reason == BEYOND_USE and suspects is None:
            rest = with_nearer_datum(network, adjustment, points_far_off(adjustment))
        if rest is None and sound.reason == BEYOND_USE and settings.undetermined == "leave_out":
            rest = without_moved(network, sound, sound.values, _problem_at)
        if rest is None:
            return Solved(network, sound, None, None, suspects, _other_readings(adjusted))
        return _assessed(adjusted._replace(network=rest, attempt=_attempt(rest, sound.values, None)), assessing)
    if suspects is not None:
        again = SolverSettings(settings.max_iterations)
        quality, suspects = put_back(quality, suspects, lambda one: assess(one, levels(settings), aposteriori), again)
    tests = group_tests(quality, network)
    tested = (quality.groups, tests)
    told = rejection(quality, network, tests)
    found = [
        *_other_readings(adjusted, told is not Rejection.NOTHING or suspects is not None),
        *_possible_causes(quality, network, told, suspects),
    ]
    possible = tuple({(one.cause, one.things): one for one in found}.values())[:3]
    iterate = settings.variance_components == "iterate"
    quality, treatment = treat(
        quality,
        levels(settings),
        aposteriori,
        TreatmentOptions(settings.snooping, settings.robust, iterate, settings.variance_method),
        suspects,
    )
    last = quality.adjustment._replace(start=adjustment.start, iterations=adjustment.iterations)
    quality = replace(quality, adjustment=last)
    return Solved(network, last, quality, treatment, suspects, possible, tested)


def _too_weak(adjustment: Adjustment, levels: Levels) -> Adjustment | None:
    """An adjustment that found no minimum where it fits the observations, if that is as its σ are beyond any use."""
    if adjustment.outcome not in (Outcome.NOT_CONVERGED, Outcome.DIVERGED) or not fits(adjustment):
        return None
    here = adjust(adjustment.problem, adjustment.values, SolverSettings(max_iterations=0))
    if here.outcome is Outcome.NOT_CONVERGED:
        here = checked(assess(here, levels, aposteriori=False))
    if here.outcome is not Outcome.SINGULAR:
        return None
    return here._replace(start=adjustment.start, iterations=adjustment.iterations)


def _possible_causes(
    quality: Quality, network: Network, told: Rejection, suspects: SuspectedOutliers | None
) -> tuple[ScoredHypothesis, ...]:
    if suspects is None and told is Rejection.NOTHING:
        return ()
    # Loading these takes its time.
    from mor.diagnose.score_tests import score_tests, score_tests_with_suspects, sigma_tests

    with np.errstate(all="ignore"):
        found = score_tests_with_suspects(quality, network, suspects) if suspects is not None else ()
        if found or told is Rejection.NOTHING:
            return found
        return score_tests(quality, network) if told is Rejection.LARGER else sigma_tests(quality)


def _other_readings(adjusted: _Adjusted, rejected: bool = True) -> tuple[ScoredHypothesis, ...]:
    """Other readings of what is rejected by the given start values, and by sights if no plain solution is sensible."""
    attempt, network = adjusted.attempt, adjusted.network.original or adjusted.network
    ended = attempt.adjustment
    senseless = attempt.robust is not None or (not ended.outcome.is_solution and bool(ended.iterations))
    if not rejected and not senseless:
        return ()
    # Loading these takes its time.
    from mor.diagnose.angles import scored_readings
    from mor.diagnose.search import scored_readings_of_tables

    with np.errstate(all="ignore"):
        found = scored_readings_of_tables(network, make_problem, start_or_nothing) if rejected else ()
        if senseless:
            states = [adjusted.start, attempt.robust, ended.values]
            found += scored_readings(network, [values for values in states if values is not None])
    return found


def _diagnosis(adjusted: _Adjusted, solved: Solved, go_on: GoOn) -> Diagnosis:
    from mor.diagnose.search import RejectedAdjustment, causes

    attempt, quality = adjusted.attempt, solved.quality
    solution = solved.adjustment if solved.adjustment.outcome.is_solution else None
    plain = attempt.adjustment  # of all observations
    if attempt.suspects is not None:
        plain = solved.adjustment if solved.suspects is None else attempt.suspects.plain
    told = Rejection.LARGER  # if there is no solution, or none of all observations
    if solution is not None and quality is not None and solved.suspects is None:
        told = rejection(quality, solved.network, solved.tested[1] if solved.tested else None)
    if told is Rejection.NOTHING:
        return NOTHING_FOUND
    ended = RejectedAdjustment(plain, solution, quality, told, attempt.robust, solved.possible_causes)
    start = adjusted.start if solution is None else _start_from(adjusted, solution.values)
    return causes(adjusted.whole, start, ended, make_problem, start_or_nothing, go_on)


def _start_from(adjusted: _Adjusted, values: Values) -> Mapping[str, FloatArray]:
    found = {kind: values[kind][: len(own)].copy() for kind, own in adjusted.start.items()}
    names = {thing.name for thing in adjusted.network.undeterminable if thing.kind == "point"}
    left: BoolArray = np.array([name in names for name in adjusted.whole.blocks["point"].ids], dtype=bool)
    found["point"][left] = adjusted.start["point"][left]
    return found


def _undefined(problem: Problem, start: Mapping[str, FloatArray]) -> list[Message]:
    mistakes = []
    for group in problem.groups:
        for row in undefined_rows(group, problem.index, start)[:MOST_TOLD].tolist():
            names = ", ".join(f"{key} {name!r}" for key, name in group.names_of(row).items())
            words = f"{group.type.name}, {names}: no value or no derivative at the start values"
            angles = all(slot.kind == ROTATION.key for slot in group.type.slots)
            asked = f"{words}; is phi ±100 gon there?" if angles else f"{words}; do two of its points coincide there?"
            mistakes.append(group.message(row, asked))
    return mistakes or [Message("observations have no value or no derivative at the last iteration")]


def snooped(network: Network) -> Network:
    """The network with data snooping asked for."""
    settings = network.project.settings.model_copy(update={"snooping": True})
    return replace(network, project=network.project.model_copy(update={"settings": settings}))


def levels(settings: ProjectSettings) -> Levels:
    """Levels of the tests of a project."""
    return Levels(
        settings.snooping_level,
        settings.power,
        settings.global_level,
        settings.familywise_level,
        settings.least_redundancy,
    )


def check_minimal(network: Network, adjustment: Adjustment) -> None:
    """Raise :class:`InputError` where a minimal datum names more coordinates than the network has free movements."""
    if network.datum.minimal:
        named = int(np.count_nonzero(adjustment.constraint.mask))
        defect = len(adjustment.defect.movements)
        if named != defect:
            movements = ", ".join(adjustment.defect.movements) or "none"
            words = f"datum: minimal names {named} free coordinates, but the network has {defect} free movements"
            raise InputError([Message(f"{words} ({movements})")])


def _with_settled_sigma(
    network: Network, adjustment: Adjustment, watch: Watcher | None, suspects: SuspectedOutliers | None = None
) -> Adjustment:
    """The adjustment with σ that depend on distances taken at its own result, whatever the start values were.

    So are the knots about rows that a rolling shutter reads out on a trajectory.
    """
    for _ in range(4):
        problem = make_problem(network, adjustment.start, adjustment.values)
        problem = left_out(problem, suspects) if suspects is not None else problem
        if _same_sigma(problem, adjustment.problem) or not adjustment.outcome.is_solution:
            break
        settings = SolverSettings(network.project.settings.max_iterations)
        count = len(adjustment.iterations)
        again = adjust(problem, adjustment.values, settings, counting_on(watch, count))
        further = tuple(step._replace(number=step.number + count) for step in again.iterations)
        adjustment = again._replace(start=adjustment.start, iterations=adjustment.iterations + further)
    return adjustment


def _same_sigma(one: Problem, other: Problem) -> bool:
    """True if two problems have the same σ and, of trajectories, rows between the same knots."""
    # σ that change by less between two adjustments have settled.
    return all(
        (a.sigma is b.sigma or np.allclose(a.sigma, b.sigma, rtol=1e-9, atol=0.0, equal_nan=True))
        and all(map(np.array_equal, a.blocks, b.blocks))
        for a, b in zip(one.groups, other.groups, strict=True)
    )
