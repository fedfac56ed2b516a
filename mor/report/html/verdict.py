"""The verdict in plain words: statements, each with its numbers, good, doubtful or bad."""

from __future__ import annotations

import re
from typing import Any, NamedTuple

import numpy as np
import polars as pl

from mor.errors import Undeterminable
from mor.report.html.derived import rms
from mor.report.html.figures.layout import small_unit
from mor.report.html.page_data import PageData
from mor.report.html.provenance import datum_in_words, epoch_in_words, help_in_words, used_in_words
from mor.report.layout import component_of
from mor.report.text.gross_errors.hypotheses import decrease, sentence
from mor.report.text.gross_errors.suspects import sentences
from mor.report.text.reliability import mostly_out_in_words
from mor.report.text.undetermined import sentences_of_things
from mor.report.verdict.sentences import contradictions, ill_determined, in_common, said_conventions
from mor.report.verdict.words_of_reliability import uncontrolled_in_words, uncontrolled_sentence
from mor.report.words.language import Words

GOOD, DOUBT, BAD, PLAIN = "good", "doubt", "bad", "plain"
_NARROW = {"gon": 10.0, "deg": 9.0}
_LOW_R = 0.1
_STRONG = 0.95
_NAMED = 3
"""Observations that nothing controls that are named one by one."""
_NEGATIVE = re.compile(r"(?<![\w-])-(?=\d)|(?<=e)-(?=\d)")
"""Hyphens that are minus signs."""


class Statement(NamedTuple):
    """A statement of the verdict, and the numbers it rests on."""

    state: str
    title: str
    words: str
    link: str = ""
    """Section of the page, or table of it, that has more."""


def statements(data: PageData) -> list[Statement]:
    """The statements, the most important first."""
    parts = [
        *_causes(data),
        _global(data),
        _groups(data),
        _worst(data),
        _controlled(data),
        _checks(data),
        _points(data),
        _geometry(data),
    ]
    found = [statement for statement in [*parts, *_cameras(data), *_rests_on(data)] if statement is not None]
    return [statement._replace(words=_NEGATIVE.sub("−", statement.words)) for statement in found]


def headline(data: PageData) -> Statement:
    """One sentence: accepted or not."""
    summary, say = data.view.summary, data.words
    test, count = summary["global_test"], summary["iterations"]
    if summary["redundancy"] == 0:
        words = say(
            "The adjustment converged after {count:iteration|iterations}, but the redundancy is 0: nothing is tested.",
            count=count,
        )
        return Statement(BAD, say("Not controlled"), words)
    shared = in_common(data.view.gross_errors.get("in_common", []), say)
    left_out = sentences(data.view.suspects, say)
    if left_out:
        return Statement(BAD, say("Not accepted"), " ".join([*left_out, *shared]))
    emptied = [*_emptied(data), *_mostly_out(data)]
    things = tuple(_thing(row) for row in summary.get("undeterminable", []))
    emptied += sentences_of_things(things, say)
    flagged = " ".join([_flagged(summary["flagged"], say), *shared, *emptied])
    contradicted = contradictions(data.view.verdict, say)
    open_ = ill_determined(data.view.verdict, summary["units"]["length"], say)
    whole = not open_ or bool((data.view.verdict or {})["determined"]["as_a_whole"])
    flagged = " ".join([*open_, flagged])
    if not test["accepted"]:
        larger = test["statistic"] > test["upper"]
        words = say(
            "The adjustment converged after {count:iteration|iterations}, but the global test rejects it: "
            "residuals are {size} than the σ given a priori say (σ0 a posteriori / a priori = {ratio}).",
            count=count,
            size=say("larger") if larger else say("smaller"),
            ratio=f"{summary['sigma0']['ratio_of_sigmas']:.3f}",
        )
        words = " ".join([words, *contradicted, flagged])
        return Statement(BAD if larger else DOUBT, say("Not accepted"), words)
    words = say(
        "The adjustment converged after {count:iteration|iterations}, the global test accepts it.",
        count=count,
    )
    if contradicted:
        return Statement(BAD, say("Not accepted"), " ".join([words, *contradicted, flagged]))
    if not whole:
        return Statement(BAD, say("Not determined"), f"{words} {flagged}")
    if open_:
        return Statement(DOUBT, say("Accepted, but partly ill-determined"), f"{words} {flagged}")
    loose = summary.get("uncontrolled") or 0
    if loose:
        title = say("Accepted, {count:observation|observations} uncontrolled", count=loose)
        return Statement(DOUBT, title, f"{words} {flagged}")
    if summary["flagged"] or emptied:
        return Statement(DOUBT, say("Accepted, with observations to look at"), f"{words} {flagged}")
    return Statement(GOOD, say("Accepted"), f"{words} {flagged}")


def _rests_on(data: PageData) -> list[Statement]:
    """Datum, what was used of what was read, what would help: no judgement, but asked of every adjustment."""
    say = data.words
    return [
        Statement(PLAIN, say("Datum"), datum_in_words(data), "key-figures"),
        _another_epoch(data),
        Statement(PLAIN, say("What was used"), used_in_words(data), "files"),
        Statement(PLAIN, say("What would help"), help_in_words(data), "points"),
    ]


def _another_epoch(data: PageData) -> Statement:
    """State whether the result can be compared with another epoch."""
    say, accepted = data.words, data.view.summary["global_test"]["accepted"]
    if accepted and headline(data).state != BAD:
        return Statement(PLAIN, say("Another epoch"), epoch_in_words(data))
    first = say("Not yet: this one is not accepted, and movements would be tested with σ that do not hold.")
    return Statement(DOUBT, say("Another epoch"), f"{first} {epoch_in_words(data)}")


def _causes(data: PageData) -> list[Statement]:
    """Possible causes of what is rejected, not verified."""
    return [
        Statement(
            DOUBT,
            data.words("Possible cause"),
            data.words(
                "{cause}. {effect}. Not verified: run mor diagnose; to try it: {line}",
                cause=sentence(row, data.words),
                effect=decrease(row, data.words),
                line=row["line"],
            ),
        )
        for row in data.view.possible_causes
    ]


def _thing(row: dict[str, Any]) -> Undeterminable:
    return Undeterminable(row["kind"], row["id"], row["reason"], row["treatment"], row["observations"])


def _emptied(data: PageData) -> list[str]:
    """Groups of which nothing takes part any more: what tests accept then says nothing about them."""
    return [
        data.words(
            "Nothing is left of {group}: all of it was taken out ({count}).",
            count=row["excluded"],
            group=row["name"],
        )
        for row in data.view.groups.to_dicts()
        if row["observations"] == 0 and row["excluded"] > 0
    ]


def _mostly_out(data: PageData) -> list[str]:
    """Points, images or stations most of whose observations were excluded."""
    snooping = data.view.gross_errors.get("snooping")
    return mostly_out_in_words((snooping or {}).get("mostly_out", []), data.words, _NAMED)


def _flagged(count: int, say: Words) -> str:
    if count == 0:
        return say("No observation is flagged.")
    return say("{count:observation is|observations are} flagged.", count=count)


def _global(data: PageData) -> Statement | None:
    summary, say = data.view.summary, data.words
    test, sigma0 = summary["global_test"], summary["sigma0"]
    if summary["redundancy"] == 0:
        return None
    numbers = say(
        "vᵀPv = {statistic} with {redundancy:degree|degrees} of freedom, accepted between {lower} and {upper} "
        "(χ², level {level}); σ0 a posteriori / a priori = {ratio}.",
        statistic=f"{test['statistic']:.1f}",
        redundancy=summary["redundancy"],
        lower=f"{test['lower']:.1f}",
        upper=f"{test['upper']:.1f}",
        level=f"{test['level']:g}",
        ratio=f"{sigma0['ratio_of_sigmas']:.3f}",
    )
    larger = test["statistic"] > test["upper"]
    if test["accepted"]:
        advice = say("Residuals agree with the σ given a priori.")
    elif larger:
        advice = say(
            "Residuals are larger than the σ given a priori say: look for gross errors first, then for a model that "
            "lacks something, then enlarge the σ of the groups that need it."
        )
    else:
        advice = say(
            "Residuals are smaller than the σ given a priori say: the observations are better than was assumed."
        )
    state = GOOD if test["accepted"] else BAD if larger else DOUBT
    return Statement(state, say("Global test"), f"{advice} {numbers}", "key-figures")


def _groups(data: PageData) -> Statement | None:
    """Tests of groups, and what is chosen and not measured."""
    tested, say = data.view.verdict, data.words
    if tested is None:
        return None
    found = contradictions(tested, say)
    if not found and tested["tests"]:
        found = [
            say(
                "{count:test|tests} of groups; all together reject by mistake with {level}, each with {each} (Sidak).",
                count=tested["tests"],
                level=f"{tested['level_of_groups']:g}",
                each=f"{tested['level_of_each_group']:.2g}",
            ),
            say("None of them rejects."),
        ]
    found += said_conventions(tested, say)
    state = BAD if tested["rejected"] else GOOD if tested["tests"] else PLAIN
    return Statement(state, say("Tests of groups"), " ".join(found), "groups") if found else None


def _worst(data: PageData) -> Statement | None:
    used = data.view.used.filter(pl.col("w").is_not_null())
    if used.height == 0:
        return None
    row = used[int(used["w"].abs().arg_max() or 0)].row(0, named=True)
    summary, say = data.view.summary, data.words
    expected = used.height * summary["snooping_level"]
    sentence = say(
        "{count} beyond |w| = {limit} (chance alone would make about {expected} of {all}). The worst is {place}: "
        "w = {w}, estimated error {error} {unit}.",
        count=summary["flagged"],
        limit=f"{data.view.critical:.2f}",
        expected=f"{expected:.1f}" if expected >= 0.05 else f"{expected:.1g}",
        all=used.height,
        place=place(row),
        w=f"{row['w']:.2f}",
        error=f"{row['error']:.3g}",
        unit=row["unit"],
    )
    many = summary["flagged"] > expected + 3.0 * np.sqrt(max(expected, 1.0))
    state = GOOD if not summary["flagged"] else BAD if many else DOUBT
    return Statement(state, say("Single observations"), sentence, "residuals")


def place(row: dict[str, Any]) -> str:
    """An observation in words: type, between what, component."""
    between = " – ".join(part for part in (row["at"], row["from"], row["to"]) if part)
    return f"{row['type']} {between}{component_of(row)}"


def _controlled(data: PageData) -> Statement | None:
    used, say = data.view.used.filter(pl.col("r").is_not_null()), data.words
    if used.height == 0:
        return None
    low = used.filter(pl.col("r") < _LOW_R).height
    free, found = data.view.summary.get("uncontrolled") or 0, data.view.reliability
    words = say(
        "Mean redundancy number {mean}; {low} of {all:observation|observations} have r < {limit}.",
        mean=f"{float(used['r'].to_numpy().mean()):.2f}",
        low=low,
        all=used.height,
        limit=f"{_LOW_R:g}",
    )
    if found is not None:
        words = " ".join([words, *_uncontrolled(found, say)])
    state = DOUBT if low > 0.05 * used.height or free else GOOD
    return Statement(state, say("Reliability"), words, "tests")


def _uncontrolled(found: dict[str, Any], say: Words) -> list[str]:
    """Count the uncontrolled observations and name the first."""
    lines = uncontrolled_in_words({**found, "observations": []}, say)[:1]
    return lines + [f"{uncontrolled_sentence(row, say)}." for row in found["observations"][:_NAMED]]


def _checks(data: PageData) -> Statement | None:
    checks, say = data.view.checks, data.words
    if not checks:
        return None
    worst = max(checks, key=lambda row: abs(row["largest"]))
    beyond = int(sum(row["exceeding"] for row in checks))
    parts = "; ".join(
        f"{row['group']} {row['component']}: {say('rms')} {row['rms']:.3g} {row['unit']} ({int(row['count'])})"
        for row in checks
    )
    words = say(
        "{parts}. Largest deviation {largest} {unit}; {beyond} beyond their test.",
        parts=parts,
        largest=f"{worst['largest']:.3g}",
        unit=worst["unit"],
        beyond=beyond,
    )
    return Statement(DOUBT if beyond else GOOD, say("Checks kept out"), words, "control")


def _points(data: PageData) -> Statement | None:
    points, say = data.points.filter(pl.col("status").is_in(["free", "partly fixed"])), data.words
    if points.height == 0:
        return None
    sigma = [rms(points[f"s{name}"].cast(pl.Float64).fill_null(np.nan).to_numpy()) for name in "xyz"]
    worst = points.sort("ellipsoid_a", descending=True, nulls_last=True, maintain_order=True).row(
        0, named=True
    )
    unit, factor = small_unit(data.view.length, worst["ellipsoid_a"] or max(filter(None, sigma), default=1.0))
    numbers = ", ".join(
        f"σ{name.upper()} {factor * value:.3g} {unit}"
        for name, value in zip("xyz", sigma, strict=True)
        if value
    )
    words = say("Root mean square {numbers}; the weakest point is {id}", numbers=numbers, id=worst["id"])
    if worst["ellipsoid_a"]:
        axis = f"{factor * worst['ellipsoid_a']:.3g}"
        words += " " + say("(longest semi-axis of its ellipsoid {axis} {unit})", axis=axis, unit=unit)
    return Statement(PLAIN, say("Points"), f"{words}. {say('Datum: {datum}.', datum=data.datum)}", "points")


def _geometry(data: PageData) -> Statement | None:
    if not len(data.rays.frame):
        return None
    only = data.points.filter(pl.col("others") == 0)
    two = (data.view.reliability or {}).get("points_barely_determined", 0)
    narrow = only.filter(pl.col("angle") < _NARROW[data.angle_unit]).height
    words = data.words(
        "{two:point has|points have} at most one observation more than they need (two rays, or sights and distances "
        "instead); {narrow} of those that only rays determine under less than {limit} {unit}.",
        two=two,
        narrow=narrow,
        limit=f"{_NARROW[data.angle_unit]:g}",
        unit=data.angle_unit,
    )
    return Statement(DOUBT if two or narrow else GOOD, data.words("Rays"), words, "tests")


def _cameras(data: PageData) -> list[Statement]:
    return [_camera(camera, data.words) for camera in data.view.cameras]


def _camera(camera: dict[str, Any], say: Words) -> Statement:
    first, component = next(iter(camera["components"].items()))
    value = f"{first} = {component['value']:.6g}"
    value += (
        f" ± {component['sigma']:.2g} {camera['unit']}"
        if component["sigma"]
        else f" {camera['unit']} ({say('fixed')})"
    )
    names, matrix = camera["correlations"]["components"], camera["correlations"]["matrix"]
    weak = [name for name, c in camera["components"].items() if _insignificant(name, c)]
    words = f"{value}."
    strong = _strongest(names, matrix)
    if strong is not None:
        words += " " + say(
            "Largest correlation {size} between {one} and {other}.",
            size=f"{strong[2]:.2f}",
            one=strong[0],
            other=strong[1],
        )
    words += " " + say("Not significant: {names}.", names=", ".join(weak)) if weak else ""
    doubt = weak or (strong is not None and abs(strong[2]) > _STRONG)
    return Statement(DOUBT if doubt else GOOD, say("Camera {id}", id=camera["id"]), words, "cameras")


def _insignificant(name: str, component: dict[str, Any]) -> bool:
    return name not in ("c", "fx", "fy", "f", "xh", "yh", "cx", "cy") and bool(
        component["sigma"] and abs(component["value"]) < 1.96 * component["sigma"]
    )


def _strongest(names: list[str], matrix: list[list[float]] | None) -> tuple[str, str, float] | None:
    if matrix is None or len(names) < 2:
        return None
    lower = np.tril(np.array(matrix), -1)
    i, j = np.unravel_index(int(np.argmax(np.abs(lower))), lower.shape)
    return names[j], names[i], float(lower[i, j])
