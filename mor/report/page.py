"""The HTML page of results."""

from __future__ import annotations

import re
from collections.abc import Iterable, Mapping, Sequence
from contextlib import suppress
from hashlib import sha256
from importlib.resources import files
from pathlib import Path
from typing import Any, Literal, NamedTuple

import numpy as np
import polars as pl
from jinja2 import BytecodeCache, Environment, PackageLoader, StrictUndefined
from jinja2.bccache import Bucket
from markupsafe import Markup
from scipy.special import ndtr

from mor import __version__
from mor.errors import UndeterminedObject
from mor.linalg.compilation import cache_root
from mor.model.parameters import INTERIORS
from mor.quality.solution import Solved
from mor.report.figures import camera_figures, overlap, overlap_map, test_figures
from mor.report.language import ENGLISH, Words
from mor.report.layout import (
    DIGITS,
    component_of,
    fixed,
    in_words,
    persons,
    probability,
    row_in_words,
    short,
    small_unit,
)
from mor.report.movements import moved_points, movement_drawing
from mor.report.page_data import (
    MOST_ROWS,
    MOST_VECTORS,
    PageData,
    chart_library,
    control_table,
    deviations_of_points,
    page_data,
    payload,
    rms,
)
from mor.report.summary import failure, summary
from mor.report.text import verdict
from mor.report.text_findings import (
    decrease,
    emptied,
    mostly_out_in_words,
    sentence,
    sentences,
    sentences_of_things,
    undetermined_section,
)
from mor.report.text_tables import listed_movements
from mor.report.verdict import (
    contradictions,
    ill_determined,
    in_common,
    said_conventions,
    tests_in_words,
    uncontrolled_in_words,
    uncontrolled_sentence,
)
from mor.report.view import View

# ---- The page on paper: running heads with the project, page numbers.


def running_heads(title: str, identity: dict[str, Any], words: Words) -> Markup:
    """Style sheet of what stands above and below every printed page: project, program, date, number of the page."""
    right = " · ".join(part for part in (identity["date"], identity["program"]) if part)
    head = title if len(title) <= 70 else f"{title[:69]}…"
    of = _css_text(words("page"))
    small = 'font: 8pt system-ui, "Segoe UI", "DejaVu Sans", sans-serif; color: #444; white-space: nowrap;'
    return Markup(
        "@page { "
        f"@top-left {{ content: {_css_text(head)}; {small} }} "
        f"@top-right {{ content: {_css_text(right)}; {small} }} "
        f'@bottom-right {{ content: {of} " " counter(page) " / " counter(pages); {small} }} '
        "}"
    )


def _css_text(text: str) -> str:
    """A text of CSS that may stand in a style element: whatever has a meaning there is spelled out."""
    spelled = re.sub(r'[\x00-\x1f\\"<>&]', lambda sign: f"\\{max(ord(sign[0]), 32):x} ", text)
    return f'"{spelled}"'


# ---- Statements on what an adjustment rests on: what was read and used, which datum, what would make it better.

_NAMED = 3
"""Observations without control that are named."""


def used_in_words(data: PageData) -> str:
    """From how many files, how many observations took part, and whether anything was left out or noted."""
    view, say = data.view, data.words
    out = view.residuals.height - view.used.height
    parts = [
        say(
            "{files:file|files} read, {count:observation|observations} adjusted, {out} not used.",
            files=len(view.identity["inputs"]),
            count=view.used.height,
            out=out,
        )
    ]
    things = len(view.summary.get("undeterminable", []))
    if things:
        parts.append(say("{count:object is|objects are} not determined.", count=things))
    if view.notes:
        parts.append(say("{count:note|notes} under Files.", count=len(view.notes)))
    return " ".join(parts)


def next_steps(data: PageData) -> list[str]:
    """The three things to do next, the most urgent first."""
    view, say = data.view, data.words
    steps = [f"{one.title}: {one.words}" for one in _causes(data)]
    flagged = [row for row in view.gross_errors.get("suspicious", []) if row["flagged"]]
    if flagged:
        steps.append(
            say(
                "Look at the observation {place} (w = {w}, estimated error {error} {unit}).",
                place=in_words(flagged[0], say),
                w=f"{flagged[0]['w']:.2f}".replace("-", "−"),
                error=short(flagged[0]["error"], 3),
                unit=flagged[0]["unit"],
            )
        )
    accepted = view.summary["global_test"]["accepted"]
    if not accepted:
        ratio = f"{view.summary['sigma0']['ratio_of_sigmas']:.2f}"
        steps.append(
            say("Check the σ of the observations: the residuals are {ratio} times as large as these say.", ratio=ratio)
        )
    free = (view.reliability or {}).get("observations", [])
    if free:
        names = "; ".join([*dict.fromkeys(row_in_words(row, say) for row in free)][:_NAMED])
        steps.append(say("Measure a second observation for the uncontrolled ones: {names}.", names=names))
    if accepted and data.points["ellipsoid_a"].drop_nulls().len():
        worst = data.points.sort("ellipsoid_a", descending=True, nulls_last=True).row(0, named=True)
        unit, factor = small_unit(view.length, worst["ellipsoid_a"])
        said = "Point {point} is the least precise one (semi-axis {size} {unit}): observe it more often."
        steps.append(say(said, point=worst["id"], size=f"{worst['ellipsoid_a'] * factor:.3g}", unit=unit))
    steps.append(say("mor design adjusted.yaml --rank shows the effect of each additional observation."))
    steps.append(say("mor report prints the report to sign (--pdf)."))
    return steps[:3]


def listed_notes(rows: Sequence[Mapping[str, Any]], words: Words) -> dict[str, Any]:
    """The first notes with their places, in the language of the page, and how many more there are."""
    notes = [
        {"place": f"{row['file']}:{row['line']}" if row["line"] else row["file"], "message": words.told(row["message"])}
        # Notes that are listed.
        for row in rows[:200]
    ]
    return {"notes": notes, "notes_left": len(rows) - len(notes)}


# ---- The verdict in plain words: statements, each with its numbers, good, doubtful or bad.

State = Literal["good", "doubt", "bad", "plain"]


class Statement(NamedTuple):
    """A statement of the verdict, and the numbers it rests on."""

    state: State
    title: str
    words: str = ""
    link: str = ""
    """Section of the page, or table of it, that has more."""


def statements(data: PageData) -> list[Statement]:
    """The statements, the most important first."""
    return [*_signed(_causes(data)), *judgements(data), *_signed(_rests_on(data))]


def judgements(data: PageData) -> list[Statement]:
    """The statements that judge the adjustment, the most important first; they name no commands."""
    parts = [
        _global(data),
        _groups(data),
        _worst(data),
        _controlled(data),
        _checks(data),
        _points(data),
        _geometry(data),
        *[_camera(camera, data.words) for camera in data.view.cameras],
    ]
    return _signed(statement for statement in parts if statement is not None)


def _signed(found: Iterable[Statement]) -> list[Statement]:
    # Hyphens that are minus signs.
    negative = re.compile(r"(?<![\w-])-(?=\d)|(?<=e)-(?=\d)")
    return [statement._replace(words=negative.sub("−", statement.words)) for statement in found]


def agreement(data: PageData) -> Statement:
    """First part of the verdict: whether the observations agree with each other and with their σ."""
    view, say, test = data.view, data.words, data.view.summary["global_test"]
    left_out = sentences(view.suspects, say)
    flagged = _flagged(view.summary["flagged"], say)
    shared = in_common(view.gross_errors.get("in_common", []), say)
    contradicted = contradictions(view.verdict, say)
    if view.summary["redundancy"] == 0:
        return Statement("bad", say("not tested"), say("The redundancy is 0: nothing is tested."))
    tested = (
        say("The global test accepts the adjustment.")
        if test["accepted"]
        else say("The global test rejects the adjustment.")
    )
    gone = [*emptied(view.groups.to_dicts(), say), *_mostly_out(data)]
    words = " ".join([*left_out, tested, *contradicted, flagged, *shared, *gone])
    if left_out or contradicted or not test["accepted"]:
        smaller = test["statistic"] < test["lower"] and not (left_out or contradicted)
        return Statement("doubt" if smaller else "bad", say("not accepted"), words)
    if view.summary["flagged"]:
        return Statement("doubt", say("accepted, with observations to look at"), words)
    return Statement("good", say("accepted"), words)


def determination(data: PageData) -> Statement:
    """Second part of the verdict: whether the observations determine the result everywhere."""
    view, say = data.view, data.words
    found = (view.verdict or {}).get("determined")
    things = sentences_of_things(tuple(_thing(row) for row in view.summary.get("undeterminable", [])), say)
    open_ = ill_determined(view.verdict, view.length, say)
    loose = view.summary.get("uncontrolled") or 0
    words = [*open_, *things]
    if loose:
        words.append(
            say("{count:observation is|observations are} uncontrolled: an error there would hardly show.", count=loose)
        )
    if found is None:
        return Statement("plain", say("not judged"), " ".join(words))
    if not found["as_a_whole"]:
        return Statement("bad", say("not determined"), " ".join(words))
    if open_ or things:
        return Statement("doubt", say("partly ill-determined"), " ".join(words))
    unit, factor = small_unit(view.length, found["largest_sigma"])
    words.insert(
        0,
        say(
            "Every position is determined; the largest standard deviation is {sigma} {unit}.",
            sigma=f"{found['largest_sigma'] * factor:.3g}",
            unit=unit,
        ),
    )
    state: State = "doubt" if loose else "good"
    return Statement(state, say("determined, partly uncontrolled") if loose else say("determined"), " ".join(words))


def headline(data: PageData) -> Statement:
    """State and title: is the adjustment accepted?"""
    view, say = data.view, data.words
    test, loose = view.summary["global_test"], view.summary.get("uncontrolled") or 0
    open_ = ill_determined(view.verdict, view.length, say)
    things = [row for row in view.summary.get("undeterminable", []) if row["treatment"]]
    if view.summary["redundancy"] == 0:
        return Statement("bad", say("Not controlled"))
    if view.suspects is None and test["statistic"] < test["lower"]:
        return Statement("doubt", say("Not accepted"))
    if view.suspects is not None or not test["accepted"] or contradictions(view.verdict, say):
        return Statement("bad", say("Not accepted"))
    if open_ and not (view.verdict or {})["determined"]["as_a_whole"]:
        return Statement("bad", say("Not determined"))
    if open_:
        return Statement("doubt", say("Accepted, but partly ill-determined"))
    if loose:
        return Statement("doubt", say("Accepted, {count:observation|observations} uncontrolled", count=loose))
    if view.summary["flagged"] or emptied(view.groups.to_dicts(), say) or _mostly_out(data) or things:
        return Statement("doubt", say("Accepted, with observations to look at"))
    return Statement("good", say("Accepted"))


def _rests_on(data: PageData) -> list[Statement]:
    """Datum, what was used of what was read, what would help: no judgement, but asked of every adjustment."""
    say = data.words
    other = say(
        "mor compare OTHER THIS --epochs transforms both to the datum of their common points and tests the movements; "
        "differences of coordinates in two datums are not movements."
    )
    ready = data.view.summary["global_test"]["accepted"] and headline(data).state != "bad"
    if not ready:
        first = say("Not yet: this adjustment is not accepted, so movements would be tested with wrong σ.")
        other = f"{first} {other}"
    return [
        Statement(
            "plain", say("Datum"), say("{datum}. Coordinates and σ refer to it.", datum=data.datum), "key-figures"
        ),
        Statement("plain" if ready else "doubt", say("Another epoch"), other),
        Statement("plain", say("Input"), used_in_words(data), "files"),
    ]


def _causes(data: PageData) -> list[Statement]:
    return [
        Statement(
            "doubt",
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


def _thing(row: dict[str, Any]) -> UndeterminedObject:
    return UndeterminedObject(row["kind"], row["id"], row["reason"], row["treatment"], row["observations"])


def _mostly_out(data: PageData) -> list[str]:
    return mostly_out_in_words((data.view.gross_errors.get("snooping") or {}).get("mostly_out", []), data.words, _NAMED)


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
    state: State = "good" if test["accepted"] else "bad" if larger else "doubt"
    return Statement(state, say("Global test"), f"{advice} {numbers}", "key-figures")


def _groups(data: PageData) -> Statement | None:
    tested, say = data.view.verdict, data.words
    if tested is None:
        return None
    found = contradictions(tested, say)
    if not found and tested["tests"]:
        found = [tests_in_words(tested, say), say("None of them rejects.")]
    found += said_conventions(tested, say)
    state: State = "bad" if tested["rejected"] else "good" if tested["tests"] else "plain"
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
    state: State = "good" if not summary["flagged"] else "bad" if many else "doubt"
    return Statement(state, say("Single observations"), sentence, "residuals")


def place(row: dict[str, Any]) -> str:
    """An observation in words: type, between what, component."""
    between = " – ".join(part for part in (row["at"], row["from"], row["to"]) if part)
    return f"{row['type']} {between}{component_of(row)}"


def _controlled(data: PageData) -> Statement | None:
    used, say = data.view.used.filter(pl.col("r").is_not_null()), data.words
    if used.height == 0:
        return None
    low_r = 0.1
    low = used.filter(pl.col("r") < low_r).height
    free, found = data.view.summary.get("uncontrolled") or 0, data.view.reliability
    said = "Mean redundancy number {mean}; {low} of {all:observation|observations} have r < {limit}."
    words = say(said, mean=f"{float(used['r'].to_numpy().mean()):.2f}", low=low, all=used.height, limit=f"{low_r:g}")
    if found is not None:
        lines = uncontrolled_in_words({**found, "observations": []}, say)[:1]
        lines += [f"{uncontrolled_sentence(row, say)}." for row in found["observations"][:_NAMED]]
        words = " ".join([words, *lines])
    state: State = "doubt" if low > 0.05 * used.height or free else "good"
    return Statement(state, say("Reliability"), words, "tests")


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
    said = "{parts}. Largest deviation {largest} {unit}; {beyond} beyond their test."
    words = say(said, parts=parts, largest=f"{worst['largest']:.3g}", unit=worst["unit"], beyond=beyond)
    return Statement("doubt" if beyond else "good", say("Checks"), words, "control")


def _points(data: PageData) -> Statement | None:
    points, say = data.points.filter(pl.col("status").is_in(["free", "partly fixed"])), data.words
    if points.height == 0:
        return None
    sigma = [rms(points[f"s{name}"].cast(pl.Float64).fill_null(np.nan).to_numpy()) for name in "xyz"]
    worst = points.sort("ellipsoid_a", descending=True, nulls_last=True, maintain_order=True).row(0, named=True)
    unit, factor = small_unit(data.view.length, worst["ellipsoid_a"] or max(filter(None, sigma), default=1.0))
    numbers = ", ".join(
        f"σ{name.upper()} {factor * value:.3g} {unit}" for name, value in zip("xyz", sigma, strict=True) if value
    )
    words = say("Root mean square {numbers}; the weakest point is {id}", numbers=numbers, id=worst["id"])
    if worst["ellipsoid_a"]:
        axis = f"{factor * worst['ellipsoid_a']:.3g}"
        words += " " + say("(longest semi-axis of its ellipsoid {axis} {unit})", axis=axis, unit=unit)
    return Statement("plain", say("Points"), f"{words}. {say('Datum: {datum}.', datum=data.datum)}", "points")


def _geometry(data: PageData) -> Statement | None:
    if not len(data.rays.frame):
        return None
    only = data.points.filter(pl.col("others") == 0)
    two = (data.view.reliability or {}).get("points_barely_determined", 0)
    limits = {"gon": 10.0, "deg": 9.0}
    narrow = only.filter(pl.col("angle") < limits[data.angle_unit]).height
    words = data.words(
        "{two:point has|points have} at most one observation more than they need (two rays, or sights and distances "
        "instead); {narrow} of those that only rays determine under less than {limit} {unit}.",
        two=two,
        narrow=narrow,
        limit=f"{limits[data.angle_unit]:g}",
        unit=data.angle_unit,
    )
    return Statement("doubt" if two or narrow else "good", data.words("Rays"), words, "tests")


def _camera(camera: dict[str, Any], say: Words) -> Statement:
    first, component = next(iter(camera["components"].items()))
    value = f"{first} = {component['value']:.6g}"
    value += (
        f" ± {component['sigma']:.2g} {camera['unit']}" if component["sigma"] else f" {camera['unit']} ({say('fixed')})"
    )
    names, matrix = camera["correlations"]["components"], camera["correlations"]["matrix"]
    weak = [
        name
        for name, c in camera["components"].items()
        if (
            name not in ("c", "fx", "fy", "f", "xh", "yh", "cx", "cy")
            and bool(c["sigma"] and abs(c["value"]) < 1.96 * c["sigma"])
        )
    ]
    words = f"{value}."
    strong = 0.0
    if matrix is not None and len(names) > 1:
        lower = np.tril(np.array(matrix), -1)
        i, j = np.unravel_index(int(np.argmax(np.abs(lower))), lower.shape)
        strong, said = float(lower[i, j]), "Largest correlation {size} between {one} and {other}."
        words += " " + say(said, size=f"{strong:.2f}", one=names[j], other=names[i])
    words += " " + say("Not significant: {names}.", names=", ".join(weak)) if weak else ""
    doubt = weak or abs(strong) > 0.95
    return Statement("doubt" if doubt else "good", say("Camera {id}", id=camera["id"]), words, "cameras")


# ---- The page: verdict, network, images, cameras, tests, tables, in one file that needs nothing else.

MOST_LISTED = 200
"""Rows of the tables that are written out (control points)."""
MEANINGS = {
    **dict.fromkeys(("c", "fx", "fy", "f"), "camera constant"),
    **dict.fromkeys(("xh", "yh", "cx", "cy"), "principal point"),
    **dict.fromkeys(("A", "K", "k", "omega"), "radial distortion"),
    **dict.fromkeys(("B", "P", "p"), "tangential distortion"),
    **dict.fromkeys(("s", "sx", "sy"), "thin prism distortion"),
    **dict.fromkeys(("C", "b", "alpha"), "affinity"),
    **dict.fromkeys(("tilt_x", "tilt_y"), "tilt of the port"),
    "distance": "distance of the port",
    **dict.fromkeys(("centre_x", "centre_y", "centre_z"), "centre of the dome"),
    "radius": "radius of the dome",
    "glass": "thickness of the glass",
    **dict.fromkeys(("n_air", "n_glass", "n_water"), "refractive index"),
}
"""What the components of the interior orientations are, by their names without numbers."""
OF_PANORAMA = {
    "rate": "rate of rotation",
    **dict.fromkeys(("ahead", "aside"), "eccentricity of the projection centre"),
    **dict.fromkeys(("lean", "pitch"), "tilt of the line"),
    "A": "distortion along the line",
    **dict.fromkeys(("a", "b"), "uneven rotation"),
}
"""The same of panoramas, where it differs."""


def meaning(model: str, name: str) -> str:
    """Return the meaning of a component of an interior orientation, or an empty text."""
    known = {**MEANINGS, **OF_PANORAMA} if model == "panorama" else MEANINGS
    return known.get(name.rstrip("0123456789"), known.get(name, ""))


def page(view: View, words: Words = ENGLISH) -> str:
    """The page of an adjustment, in a language.

    Raises :class:`mor.errors.InputError` where the chart library is missing.
    """
    data = page_data(view, words)
    cameras = camera_figures(data)
    figures: dict[str, Any] = dict(test_figures(data))
    for number, charts in enumerate(cameras):
        figures |= {f"camera{number}_{name}": chart for name, chart in charts.items()}
    covered = overlap_map(overlap(view, data.rays))
    scripts = (
        *("data.js", "theme.js", "table.js", "sketch.js", "network.js", "labels.js", "overlays.js"),
        *("images.js", "multiples.js", "overlap.js", "main.js"),
    )
    return rendered(
        "page.html.j2",
        view.summary["title"] or words("Adjustment"),
        view.identity,
        words,
        ("page.css", "epochs.css") if view.movements.height else ("page.css",),
        **_content(data),
        figures=figures,
        overlap=covered is not None,
        payload=Markup(payload(data, figures, covered)),
        library=Markup(chart_library()),
        scripts=[Markup(asset(name)) for name in scripts],
    )


def rendered(
    template: str, title: str, identity: dict[str, Any], words: Words, styles: Sequence[str], **content: Any
) -> str:
    """Return a page made from a template, with its title, running heads and style sheets."""
    content |= {"title": title, "identity": identity, "say": words, "running": running_heads(title, identity, words)}
    templates, style = environment(), Markup("".join(map(asset, styles)))
    if template == "failure.html.j2":  # its numbers are written as in the text report
        templates.filters |= {"short": short, "fixed": fixed}
    return templates.get_template(template).render(style=style, **content)


def environment() -> Environment:
    """Return the template environment with its filters."""
    environment = Environment(
        loader=PackageLoader("mor.report"),
        autoescape=True,
        undefined=StrictUndefined,
        trim_blocks=True,
        lstrip_blocks=True,
        bytecode_cache=_TemplateCache(),
    )
    environment.filters |= {
        "short": _short,
        "fixed": _fixed,
        "probability": probability,
        "coordinate": _coordinate,
        "row_in_words": row_in_words,
    }
    return environment


class _TemplateCache(BytecodeCache):
    """Compiled templates beside the kernels: compiling them takes a tenth of the time of a small network.

    A file is used only if it is whole, by the digest that it begins with. Nothing is said where none can be written.
    """

    def load_bytecode(self, bucket: Bucket) -> None:
        size = sha256().digest_size
        with suppress(OSError, RuntimeError):  # there may be no home folder
            content = self._path(bucket).read_bytes()
            if sha256(content[size:]).digest() == content[:size]:
                bucket.bytecode_from_string(content[size:])

    def dump_bytecode(self, bucket: Bucket) -> None:
        content = bucket.bytecode_to_string()
        with suppress(OSError, RuntimeError):
            path = self._path(bucket)
            path.parent.mkdir(parents=True, exist_ok=True)
            path.write_bytes(sha256(content).digest() + content)

    def _path(self, bucket: Bucket) -> Path:
        return cache_root() / "templates" / f"{__version__}-{bucket.key}"


def asset(name: str) -> str:
    """Text of a style sheet or script."""
    return files("mor.report").joinpath("assets", name).read_text(encoding="utf-8")


def _content(data: PageData) -> dict[str, Any]:
    view = data.view
    control, kind = control_table(view), Path(view.residuals_file).suffix
    sizes = [abs(value) for row in view.gross_errors.get("suspicious", []) for value in row["movement"] or ()]
    unit, factor = small_unit(view.length, max(sizes, default=1.0))
    return {
        "summary": view.summary,
        **listed_notes(view.notes, data.words),
        "persons": persons(view.identity, data.words),
        "headline": headline(data),
        "statements": statements(data),
        "parts": [(data.words("Agreement"), agreement(data)), (data.words("Determination"), determination(data))],
        "steps": next_steps(data),
        "cameras": cameras_of_page(view),
        "groups": view.groups.to_dicts(),
        "gross": view.gross_errors,
        "relative": view.relative,
        "checks": view.checks,
        "deviations": deviations_of_points(view),
        "control": control[:MOST_LISTED].to_dicts(),
        "control_left": max(0, control.height - MOST_LISTED),
        "counts": {
            "points": data.points.height,
            "images": data.images.height,
            "stations": view.stations.height,
            "residuals": view.residuals.height,
            "vectors": data.measured.height,
        },
        "limits": {"rows": MOST_ROWS, "vectors": MOST_VECTORS},
        "critical": view.critical,
        "snooping_level": view.summary["snooping_level"],
        "residuals_file": view.residuals_file,
        **{f"{name}_file": f"{name}{kind}" if kind else "" for name in ("points", "images")},
        "angle_unit": data.angle_unit,
        "sigma_words": sigma_words(data),
        "datum": data.datum,
        "moved_points": _moved_points(data),
        "movements": [data.words(name) for name in view.summary["movements"]],
        "language": data.words.language,
        "movement_unit": unit,
        "movement_factor": factor,
    }


def _moved_points(data: PageData) -> dict[str, Any] | None:
    view = data.view
    if not view.movements.height:
        return None
    last = view.movements.group_by("point", maintain_order=True).last()
    found = moved_points(view.points, last, view.summary["axes"]["xy"], view.length)
    return {
        "moved": int(last["moved"].sum()),
        "all": last.height,
        "drawing": movement_drawing(found, data.words),
        "table": listed_movements(last.sort("p", nulls_last=True), view.length, data.words, MOST_LISTED),
    }


def sigma_words(data: PageData) -> str:
    """State which σ0 every σ of the page refers to."""
    sigma0 = data.view.summary["sigma0"]
    posterior = sigma0["used_for_sigma"] != sigma0["apriori"]
    return data.words(
        "σ: standard deviations (1σ) with σ0 {which} = {used}; datum: {datum}",
        which=data.words("a posteriori") if posterior else data.words("a priori"),
        used=f"{sigma0['used_for_sigma']:.4g}",
        datum=data.datum,
    )


def cameras_of_page(view: View) -> list[dict[str, Any]]:
    """Return the cameras, each with a row for every component of its interior orientation."""
    cameras, length = [], view.summary["units"]["length"]
    for camera in view.cameras:
        quantities, rows = {c.name: c.quantity for c in INTERIORS[camera["model"]].components}, []
        for name, component in camera["components"].items():
            unit = raised(quantities[name].unit(length, "rad", camera["unit"]))
            t = abs(component["value"]) / component["sigma"] if component["sigma"] else None
            p = float(2.0 * ndtr(-t)) if t is not None else None
            of = {"name": name, "meaning": meaning(camera["model"], name), "unit": unit}
            rows.append({**of, **component, "t": t, "p": p})
        cameras.append({**camera, "rows": rows})
    return cameras


def raised(unit: str) -> str:
    """A unit with its exponent raised: 1/mm² for 1/mm^2."""
    base, _, exponent = unit.partition("^")
    return base + exponent.translate(str.maketrans("0123456789", "⁰¹²³⁴⁵⁶⁷⁸⁹"))


def _short(value: float | None, digits: int = 4) -> str:
    return "–" if value is None else f"{value:.{digits}g}".replace("-", "−")


def _coordinate(value: float | None, unit: str) -> str:
    return _fixed(value, DIGITS[unit]) if unit in DIGITS else _short(value, 9)


def _fixed(value: float | None, digits: int) -> str:
    return "–" if value is None else f"{value:.{digits}f}".replace("-", "−")


# ---- The page where there is no solution: the verdict, the iterations, what does not come to rest, what fits worst.
#
# It shows no places and no cameras: what looks like a result would be taken for one.


def failure_page(solved: Solved, identity: dict[str, Any], notes: Sequence[Mapping[str, Any]], words: Words) -> str:
    """The page of an outcome that is no solution, in a language: HTML that needs nothing else.

    ``notes`` are those of :func:`mor.report.identity.note_rows`.
    """
    data = summary(solved)
    # Things that nothing determines that are listed.
    shown = 1000
    return rendered(
        "failure.html.j2",
        data["title"] or words("Adjustment"),
        identity,
        words,
        ("page.css",),
        **listed_notes(notes, words),
        summary=data,
        persons=persons(identity, words),
        verdict=verdict(solved, words),
        explained=undetermined_section(solved, words).splitlines()[2:],
        things=data["undeterminable"][:shown],
        more=max(0, len(data["undeterminable"]) - shown),
        failure=failure(solved) or {},
    )
