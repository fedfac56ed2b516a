"""Plan a network, rank observations, write the report."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from fnmatch import fnmatchcase
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
import polars as pl

from mor.api.pipeline import read_document
from mor.api.plan import at_its_place, read_plan, solve_plan
from mor.errors import InputError, Message
from mor.linalg.compilation import chosen_by_size
from mor.model.contract import ObservationGroup
from mor.output_files import Content
from mor.plan.ranking import (
    GreedyStep,
    Ranked,
    by_worth,
    greedy,
    of_units,
    points_looked_at,
    ranked,
    weak_observations,
    wide_interest,
    wide_outcomes,
)
from mor.plan.requirements import (
    MOST_ROWS,
    PlanMeasures,
    RequiredPrecision,
    Requirement,
    RequirementResult,
    Sighted,
    chosen_names,
    interest_of,
    judged,
    least_redundancies,
    present,
    requirements,
    wanted_of,
)
from mor.project.document import Document
from mor.project.network import Network
from mor.project.schema import Variant
from mor.quality.solution import Solved
from mor.report import text_findings
from mor.report.design import (
    Named,
    design_data,
    design_page,
    design_text,
    now_row,
    ranking_table,
    ranking_text,
    requirement_section,
    variant_row,
    variant_text,
    verdict,
    visible_rows,
    visible_section,
    write_design,
)
from mor.report.identity import RunIdentity
from mor.report.language import Words, words_of
from mor.report.output_folder import Reservation, to_json
from mor.report.results import table_writer
from mor.types import BoolArray, IntArray

# ---- The ranking of a plan: what its observations and candidates are worth towards what is required.


class Ranking(NamedTuple):
    """Changes that lose least, changes that gain most, and a greedy plan."""

    network: Network
    now: PlanMeasures
    planned: tuple[Ranked, ...]
    candidates: tuple[Ranked, ...]
    steps: tuple[GreedyStep, ...]
    unestimable: tuple[tuple[int, int], ...]
    """Candidates (group, row) that would change the datum."""


def ranking(solved: Solved, required: Sequence[Requirement], most: int) -> Ranking:
    """The ranking of a plan that has a solution, and a greedy plan of up to ``most`` candidates.

    Of plans with more than ``MOST_ROWS`` rows candidates alone are ranked. Raises :class:`InputError` for greedy plans
    of these, and where too much is required of them.
    """
    quality, network = solved.quality, solved.network
    assert quality is not None
    limited = [one.blocks for one in required if isinstance(one, RequiredPrecision)]
    with chosen_by_size(network.observations), np.errstate(all="ignore"):
        every = network.things["point"].parts["position"]
        blocks = points_looked_at(limited, every)
        names = [group.name for group in (*solved.adjustment.problem.groups, *network.candidates)]
        count = network.observations + sum(int(group.mask.sum()) for group in network.candidates)
        if count + 3 * len(blocks) > MOST_ROWS:
            if most:
                words = f"greedy plans choose up to {MOST_ROWS} observations, found {count}"
                raise InputError([Message(words, "--greedy")])
            return _of_large_block(solved, required, blocks if limited else every[:0], names)
        interest = interest_of(quality, network.candidates, blocks)
        wanted = wanted_of(required, interest, quality, names)
        return Ranking(
            network,
            present(interest, wanted),
            tuple(ranked(interest, wanted, candidates=False)),
            tuple(ranked(interest, wanted, candidates=True)),
            tuple(greedy(interest, wanted, most)),
            interest.unestimable,
        )


def _of_large_block(solved: Solved, required: Sequence[Requirement], blocks: IntArray, names: Sequence[str]) -> Ranking:
    """Candidates ranked by what they do to required σ and to weak observations."""
    quality, network = solved.quality, solved.network
    assert quality is not None
    groups = solved.adjustment.problem.groups
    least = least_redundancies(required, quality, names)
    wide = wide_interest(quality, blocks, weak_observations(quality, least[: len(groups)]), network.candidates)
    wanted = wanted_of(required, wide.interest, quality, names)
    now = present(wide.interest, wanted)
    found: list[Ranked] = []
    unestimable: list[tuple[int, int]] = []
    for units, outcome, estimable in wide_outcomes(quality, wide, wanted, network.candidates, least[len(groups) :]):
        unestimable += [(u.group, u.row) for u, good in zip(units, estimable, strict=True) if not good]
        found += [one for one, good in zip(of_units(units, outcome), estimable, strict=True) if good]
    found.sort(key=lambda one: (one.unit.group, one.unit.row))
    return Ranking(network, now, (), tuple(by_worth(found, now, True)), (), tuple(unestimable))


# ---- Variants of a plan: parts left out, other σ, another lens, candidates added.


def variant_network(document: Document, folder: Path, name: str, base: Network) -> Network:
    """The network of a variant, at its place. Raises :class:`InputError` for names of nothing."""
    variant = base.project.variants[name]
    network = _with_cameras(document, folder, name, variant) if variant.cameras else base
    problems: list[Message] = []
    at = f"{network.file}: variants: {name}"
    names = [group.name for group in network.candidates]
    chosen = chosen_names(variant.candidates, names, "table of candidates", at, problems)
    kept = tuple(group for k, group in enumerate(network.candidates) if k not in chosen)
    network = replace(network, groups=(*network.groups, *(network.candidates[k] for k in chosen)), candidates=kept)
    network = _with_factors(network, variant, at, problems)
    network = _without(network, variant, at, problems)
    if problems:
        raise InputError(problems)
    return network


def solve_variant(network: Network) -> Solved:
    """The expected quality of a variant without what nothing determines any more; no solution where nothing is left."""
    settings = network.project.settings.model_copy(update={"undetermined": "leave_out"})
    lenient = replace(network, project=network.project.model_copy(update={"settings": settings}))
    try:
        return solve_plan(lenient)
    except InputError:  # nothing is left: told as it is told of a plan
        return solve_plan(network)


def _with_cameras(document: Document, folder: Path, name: str, variant: Variant) -> Network:
    cameras = dict(document.data.get("cameras") or {})
    problems = [
        Message(f"variants: {name}: there is no camera {camera!r}", document.file)
        for camera in variant.cameras
        if camera not in cameras
    ]
    if problems:
        raise InputError(problems)
    merged = {**cameras, **{c: _merged(cameras[c], keys) for c, keys in variant.cameras.items()}}
    changed = replace(document, data={**document.data, "cameras": merged})
    try:
        return at_its_place(read_plan(changed, folder).network)
    except InputError as error:
        place = f"variants: {name}: "
        raise InputError([one._replace(message=place + one.message, line=0) for one in error.problems]) from None


def _merged(given: Any, other: Any) -> Any:
    """Mappings merged key by key; what says free, fixed or observed is one value and replaced as a whole."""
    if not (isinstance(given, dict) and isinstance(other, dict)):
        return other
    if {"free", "fixed", "observed"} & given.keys():
        return other
    return {**given, **{key: _merged(given.get(key), value) for key, value in other.items()}}


def _with_factors(network: Network, variant: Variant, at: str, problems: list[Message]) -> Network:
    names = [group.name for group in network.groups]
    factors = np.ones(len(names))
    for pattern, factor in variant.factor.items():
        factors[chosen_names([pattern], names, "group of observations", at, problems)] *= factor
    groups = tuple(
        replace(group, sigma=group.sigma * f, ppm=group.ppm * f) if f != 1.0 else group
        for group, f in zip(network.groups, factors.tolist(), strict=True)
    )
    correlations = tuple(
        one._replace(covariance=one.covariance * np.outer(factors[one.groups], factors[one.groups]))
        for one in network.correlations
    )
    return replace(network, groups=groups, correlations=correlations)


def _without(network: Network, variant: Variant, at: str, problems: list[Message]) -> Network:
    wanted = variant.without
    names = [group.name for group in network.groups]
    whole = set(chosen_names(wanted.groups, names, "group of observations", at, problems))
    lost: dict[str, set[str]] = {}
    for key, space in {"points": "point", "images": "image", "stations": "station"}.items():
        things = network.things[space].ids
        lost[space] = {things[k] for k in chosen_names(getattr(wanted, key), things, space, at, problems)}
    lost["station"] |= {name for name, (station, _) in network.sets.items() if station in lost["station"]}
    out = [_lost_rows(group, lost) | (number in whole) for number, group in enumerate(network.groups)]
    groups = tuple(
        replace(group, observed=np.where(rows[:, None], np.nan, group.observed)) if rows.any() else group
        for group, rows in zip(network.groups, out, strict=True)
    )
    rest = [one.taken([~rows for rows in out]) for one in network.correlations]
    return replace(network, groups=groups, correlations=tuple(one for one in rest if len(one.rows)))


def _lost_rows(group: ObservationGroup, lost: dict[str, set[str]]) -> BoolArray:
    """(n,) rows that refer to something that is left out."""
    rows = np.zeros(group.count, dtype=bool)
    for reference, names in zip(group.type.references, group.references, strict=True):
        gone = set().union(*(lost[space] for space in reference.among if space in lost))
        if gone:
            rows |= names.texts().is_in(sorted(gone)).to_numpy()
    return rows


# ---- The design of a project: its plan, what is required of it, its variants, and what observations are worth.

AS_IT_IS = "as it is"


class Design(NamedTuple):
    """A plan with the verdict on what is required of it."""

    solved: Solved
    judged: tuple[RequirementResult, ...]
    sighted: tuple[Sighted, ...] = ()
    """Visibility, where the project leaves that open."""
    variants: tuple[Named, ...] = ()
    ranking: Ranking | None = None

    @property
    def fulfilled(self) -> bool:
        """True if there is a solution, and it reaches all that is required."""
        return self.solved.quality is not None and all(one.met for one in self.judged)

    @property
    def notes(self) -> Sequence[Message]:
        """Notes about assumptions made while the plan was read."""
        return self.solved.network.notes

    def write(self, place: Reservation, of: RunIdentity, language: str) -> None:
        """Write all files of the plan into a folder."""
        words = words_of(language, "planning")
        text = design_text(self.solved, self.judged, words, of, self._more(words))
        more: dict[str, Content] = {}
        if self.ranking is not None:
            more["ranking.csv"] = table_writer(self._ranking_table(self.ranking))
        more["design.html"] = design_page(self.solved, self.judged, self.sighted, self._variant_rows(), words, of)
        write_design(self.solved, text, self.json(of), more, place)

    def json(self, of: RunIdentity) -> str:
        """``design.json`` as text."""
        data: dict[str, Any] = design_data(self.solved, self.judged, of)
        data["visible"] = visible_rows(self.sighted)
        data["variants"] = self._variant_rows()
        found = self.ranking
        if found is not None:
            data["ranking"] = {
                "now": now_row(found.now, found.network),
                "not_ranked": len(found.unestimable),
                "rows": self._ranking_table(found).to_dicts(),
            }
        return to_json(data)

    def screen(self, words: Words) -> str:
        """Return the text for the terminal."""
        lines = verdict(self.solved, self.judged, words)
        required = requirement_section(self.solved, self.judged, words)
        if self.solved.quality is None:
            return "\n\n".join(["\n".join(lines), text_findings.undetermined_section(self.solved, words)])
        return "\n\n".join(["\n".join(lines), *([required] if required else []), *self._more(words)])

    def _more(self, words: Words) -> list[str]:
        sections = [visible_section(self.sighted, words)] if self.sighted else []
        if self.variants:
            sections.append(variant_text(self._variant_rows(), self.solved.network.project.units.length, words))
        if self.ranking is not None:
            frame = self._ranking_table(self.ranking)
            sections.append(
                ranking_text(frame, self.ranking.now, self.ranking.network, len(self.ranking.unestimable), words)
            )
        return sections

    def _variant_rows(self) -> list[dict[str, Any]]:
        if not self.variants:
            return []
        return [variant_row(*one) for one in ((AS_IT_IS, self.solved, self.judged), *self.variants)]

    def _ranking_table(self, found: Ranking) -> pl.DataFrame:
        return ranking_table(found.network, found.planned, found.candidates, found.steps)


def designed(path: Path, form: str, ranks: bool, most: int) -> Design:
    """The design of a project file, with its variants; with ``ranks`` also what its observations are worth.

    ``most`` candidates are chosen for a greedy plan. Raises :class:`InputError`.
    """
    document = read_document(path, form)
    plan = read_plan(document, path.parent)
    network = plan.network
    required = requirements(network)
    there = at_its_place(network)
    solved = solve_plan(there)
    variants = []
    for name, variant in network.project.variants.items():
        changed = solve_variant(variant_network(document, path.parent, name, there))
        wanted = [left for one in required if (left := _without_points(one, variant)) is not None]
        variants.append((name, changed, judgements(changed, wanted)))
    found = ranking(solved, required, most) if ranks and solved.quality is not None else None
    return Design(solved, judgements(solved, required), plan.sighted, tuple(variants), found)


def _without_points(required: Requirement, variant: Variant) -> Requirement | None:
    """Return the rest of a requirement if a variant leaves points out; nothing if all are left out."""
    if not isinstance(required, RequiredPrecision):
        return required
    stays: BoolArray = np.array(
        [not any(fnmatchcase(name, pattern) for pattern in variant.without.points) for name in required.names],
        dtype=bool,
    )
    names = tuple(name for name, here in zip(required.names, stays, strict=True) if here)
    return required._replace(names=names, blocks=required.blocks[stays]) if names else None


def judgements(solved: Solved, required: Sequence[Requirement]) -> tuple[RequirementResult, ...]:
    """The verdicts on what is required; none where there is no solution. What was left out has no σ."""
    quality = solved.quality
    if quality is None:
        return ()
    absent = solved.network.absent.get("point")
    return tuple(judged(one, quality, absent) for one in required)
