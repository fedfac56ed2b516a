"""Head of the report: the verdict first, then counts, σ0, global test and datum."""

from __future__ import annotations

from collections.abc import Sequence

from mor.adjustment.state import STANDS_STILL, Outcome
from mor.quality.solved import Solved
from mor.report.columns import WIDTH
from mor.report.layout import fixed, in_words, short
from mor.report.results.summary import summary
from mor.report.tables.estimates import group_table
from mor.report.tables.gross_errors.hypotheses import possible_causes
from mor.report.tables.gross_errors.suspects import suspects
from mor.report.tables.reliability import gross_errors
from mor.report.text.gross_errors.hypotheses import first_sentence
from mor.report.text.gross_errors.suspects import sentences as sentences_on_suspects
from mor.report.text.undetermined import sentences_of_things
from mor.report.verdict.group_tests import verdict_rows
from mor.report.verdict.reliability_map import reliability_rows
from mor.report.verdict.sentences import contradictions, ill_determined, in_common
from mor.report.words.datum import datum_name
from mor.report.words.language import ENGLISH, Words

NAMED = 3
"""Observations that nothing controls that are named one by one."""


def section(solved: Solved, words: Words = ENGLISH, persons: Sequence[tuple[str, str]] = ()) -> str:
    """Verdict and key figures, with ``persons``: who, for whom and when."""
    data = summary(solved)
    title = data["title"] or words("Adjustment")
    lines = [title, "=" * min(len(title), WIDTH), "", *verdict(solved, words), ""]
    movements = ", ".join(words.listed(name) for name in data["movements"])
    rows = [
        ("observations n", str(data["observations"])),
        ("unknowns u", str(data["unknowns"])),
        (
            "datum defect d",
            f"{data['defect']}" + (f" ({movements})" if movements else ""),
        ),
        ("datum", datum_name(data["datum"], words)),
        ("iterations", str(data["iterations"])),
    ]
    if solved.quality is not None:
        test, sigma0 = data["global_test"], data["sigma0"]
        rows += [
            (
                "redundancy n - u + d",
                words(
                    "{redundancy} (sum of redundancy numbers {total})",
                    redundancy=data["redundancy"],
                    total=f"{data['redundancy_sum']:.6f}",
                ),
            ),
            ("sigma0 a priori", words.number(short(sigma0["apriori"]))),
            ("sigma0 a posteriori", words.number(short(sigma0["aposteriori"], 7))),
            ("vTPv", f"{words.number(fixed(test['statistic'], 3))}, {_limits(test, words)}"),
            ("standard deviations", _multiplied(solved, words)),
            ("units", words("lengths {length}, angles {angle}", **data["units"])),
            ("residuals", words("v = adjusted - observed")),
        ]
    rows = [*persons, *((words(name), value) for name, value in rows)]
    width = max(len(name) for name, _ in rows)
    lines += [f"{name.ljust(width)}  {value}" for name, value in rows]
    return "\n".join(lines)


def verdict(solved: Solved, words: Words = ENGLISH) -> list[str]:
    """Return the verdict in words."""
    adjustment, quality = solved.adjustment, solved.quality
    if quality is None:
        reason = f", {words.told(adjustment.reason)}" if adjustment.reason else ""
        outcome = words.listed(adjustment.outcome.value) + reason
        cause = first_sentence(possible_causes(solved), words)
        return [words("NO SOLUTION: {outcome}.", outcome=outcome), *_advice(solved, words), *cause]
    lines = sentences_on_suspects(suspects(solved), words)
    lines += [words("Converged after {count:iteration|iterations}.", count=len(adjustment.iterations))]
    test = quality.global_test
    if test.redundancy == 0:
        lines.append(words("Nothing is controlled: the redundancy is 0, there is no test."))
    elif test.accepted:
        lines.append(words("Global test accepted at the level {level}.", level=f"{test.level:g}"))
    else:
        size = words("larger") if test.statistic > test.upper else words("smaller")
        lines.append(
            words(
                "Global test REJECTED at the level {level}: residuals are {size} than the a-priori sigmas say "
                "(sigma0 ratio {ratio}).",
                level=f"{test.level:g}",
                size=size,
                ratio=fixed(quality.sigma0, 3),
            )
        )
    lines += ill_determined(verdict_rows(solved), solved.network.project.units.length, words)
    lines += contradictions(verdict_rows(solved), words)
    flagged = sum(int(flags.sum()) for flags in quality.flagged)
    lines.append(
        words(
            "{count:observation|observations} with |w| > {limit}.",
            count=flagged,
            limit=fixed(quality.critical, 2),
        )
        if flagged
        else words("No observation is flagged.")
    )
    lines += in_common(gross_errors(solved).get("in_common", []), words)
    lines += first_sentence(possible_causes(solved), words)
    lines += sentences_of_things(solved.network.undeterminable, words)
    return [*lines, *(_uncontrolled(solved, words) if test.redundancy else []), *_emptied(solved, words)]


def _uncontrolled(solved: Solved, words: Words) -> list[str]:
    """Observations that hardly anything controls: no test speaks of them. A few are named."""
    data = reliability_rows(solved)
    if data is None or not data["uncontrolled"]:
        return []
    count, limit = data["uncontrolled"], f"{data['least_redundancy']:g}"
    sentence = (
        "Accepted, {count:observation|observations} uncontrolled (r < {limit})"
        if solved.accepted
        else "{count:observation is|observations are} uncontrolled (r < {limit})"
    )
    judged = words(sentence, count=count, limit=limit)
    if count > NAMED:
        return [f"{judged}."]
    return [f"{judged}: {'; '.join(in_words(row, words) for row in data['observations'])}."]


def _emptied(solved: Solved, words: Words) -> list[str]:
    """Groups of which nothing takes part any more: what tests accept then says nothing about them."""
    return [
        words(
            "Nothing is left of {group}: all of it was taken out ({count}).",
            count=row["excluded"],
            group=row["name"],
        )
        for row in group_table(solved).to_dicts()
        if row["observations"] == 0 and row["excluded"] > 0
    ]


def _advice(solved: Solved, words: Words) -> list[str]:
    """Hint for an adjustment that does not converge."""
    count = len(solved.adjustment.iterations)
    if solved.adjustment.reason == STANDS_STILL:
        return [
            words(
                "More iterations would not help: look at the observations that fit worst, and at the start values."
            )
        ]
    if solved.adjustment.outcome is Outcome.NOT_CONVERGED and not solved.adjustment.reason:
        return [
            words(
                "{count:iteration was|iterations were} not enough; settings: {{max_iterations: …}} allows more, "
                "better start values need fewer.",
                count=count,
            )
        ]
    if solved.adjustment.outcome is Outcome.DIVERGED:
        return [
            words(
                "Check the start values and look for gross errors: points mixed up, wrong units, wrong signs."
            )
        ]
    things = solved.network.undeterminable
    if any(not thing.treatment for thing in things):
        return [
            words(
                "settings: {{undetermined: leave_out}} adjusts the rest without what nothing determines "
                "({count:thing|things}, in undetermined.csv).",
                count=len(things),
            )
        ]
    return []


def _limits(test: dict[str, float], words: Words) -> str:
    return words(
        "accepted between {lower} and {upper} (chi-squared, level {level})",
        lower=fixed(test["lower"], 3),
        upper=fixed(test["upper"], 3),
        level=f"{test['level']:g}",
    )


def _multiplied(solved: Solved, words: Words) -> str:
    quality = solved.quality
    posterior = quality is not None and quality.sigma_factor != 1.0
    which = "a posteriori" if posterior else "a priori"
    datum = datum_name(solved.adjustment.problem.datum.name, words)
    return words("with sigma0 {which}, in the datum: {datum}", which=words(which), datum=datum)
