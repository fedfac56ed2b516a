"""The design of a project: its plan, what is required of it, its variants, and what observations are worth."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
import polars as pl

from mor.arrays import BoolArray
from mor.errors import Problem
from mor.output_files import Content
from mor.pipeline import read_document
from mor.planning.plan import at_its_place, read_plan, solve_plan
from mor.planning.ranks import Ranking, ranking
from mor.planning.variants import named_in, solve_variant, variant_network
from mor.project.file.plans import Variant
from mor.quality.design.requirements import Judged, RequiredPrecision, Requirement, judged, requirements
from mor.quality.design.sighted import Sighted
from mor.quality.solved import Solved
from mor.report.design.content import design_data
from mor.report.design.page import design_page
from mor.report.design.ranking import now_row, ranking_table, ranking_text
from mor.report.design.text import design_text, requirement_section, verdict
from mor.report.design.variants import Named, variant_row, variant_text
from mor.report.design.visible import visible_rows, visible_section
from mor.report.design.writing import write_design
from mor.report.identity import Identity
from mor.report.results.json_text import to_json
from mor.report.results.reservation import Reservation
from mor.report.tables.files import table_writer
from mor.report.text import undetermined
from mor.report.words.language import Words, words_of_planning

AS_IT_IS = "as it is"


class Design(NamedTuple):
    """A plan with the verdict on what is required of it."""

    solved: Solved
    judged: tuple[Judged, ...]
    sighted: tuple[Sighted, ...] = ()
    """Who sees what, where the project leaves that open."""
    variants: tuple[Named, ...] = ()
    ranking: Ranking | None = None

    @property
    def fulfilled(self) -> bool:
        """True if there is a solution, and it reaches all that is required."""
        return self.solved.quality is not None and all(one.met for one in self.judged)

    @property
    def notes(self) -> Sequence[Problem]:
        """Notes about assumptions made while the plan was read."""
        return self.solved.network.notes

    def write(self, place: Reservation, of: Identity, language: str) -> None:
        """Write all files of the plan into a folder."""
        words = words_of_planning(language)
        text = design_text(self.solved, self.judged, words, of, self._more(words))
        more: dict[str, Content] = {}
        if self.ranking is not None:
            more["ranking.csv"] = table_writer(self._ranking_table(self.ranking))
        page = design_page(self.solved, self.judged, self.sighted, self._variant_rows(), words, of)
        more["design.html"] = page
        write_design(self.solved, self.judged, text, self.json(of), more, place)

    def json(self, of: Identity) -> str:
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
            return "\n\n".join(["\n".join(lines), undetermined.section(self.solved, words)])
        return "\n\n".join(["\n".join(lines), *([required] if required else []), *self._more(words)])

    def _more(self, words: Words) -> list[str]:
        """Sections on what is visible, on variants and on what observations are worth, where they were asked for."""
        sections = [visible_section(self.sighted, words)] if self.sighted else []
        if self.variants:
            unit = self.solved.network.project.units.length
            sections.append(variant_text(self._variant_rows(), unit, words))
        if self.ranking is not None:
            frame = self._ranking_table(self.ranking)
            sections.append(
                ranking_text(
                    frame, self.ranking.now, self.ranking.network, len(self.ranking.unestimable), words
                )
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
    """What is left of a requirement where a variant leaves points out; nothing if it leaves out all of them."""
    if not isinstance(required, RequiredPrecision):
        return required
    stays: BoolArray = np.array([not named_in(variant, name) for name in required.names], dtype=bool)
    names = tuple(name for name, here in zip(required.names, stays, strict=True) if here)
    return required._replace(names=names, blocks=required.blocks[stays]) if names else None


def judgements(solved: Solved, required: Sequence[Requirement]) -> tuple[Judged, ...]:
    """The verdicts on what is required; none where there is no solution. What was left out has no σ."""
    quality = solved.quality
    if quality is None:
        return ()
    absent = solved.network.absent.get("point")
    return tuple(judged(one, quality, absent) for one in required)
