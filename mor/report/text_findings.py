"""Findings in the text report: hypotheses, suspects, reliability, undetermined unknowns."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

from mor.errors import UndeterminedObject
from mor.quality.determinability import AT_THE_START, PUT_ANYWHERE
from mor.quality.singularity import enumerated, explain_singularity, turned_about, weakness
from mor.quality.solution import Solved
from mor.report.language import ENGLISH, Words
from mor.report.layout import DIGITS, cells, fixed, heading, in_words, short, table
from mor.report.observations import fixed_point_rows, gross_errors, possible_causes, suspects
from mor.report.summary import moving_rows, summary, worst_misfits
from mor.solve.iterate import ABSURD, Outcome

# ---- Possible causes of a rejection and the results of a diagnosis, in words.

SENTENCES = {
    "names exchanged": "two names may be exchanged ({names})",
    "wrong name": "a point may have the name of another one ({names})",
    "wrong station": "a row may belong to another station or image ({names})",
    "control exchanged": "the coordinates of two control points may be exchanged ({names})",
    "control unit": "the coordinates of control points may be in another unit ({names})",
    "axes exchanged": "x and y of control points may be exchanged ({names})",
    "distance offset": "all distances of an instrument may have a common offset, such as a prism constant ({names})",
    "distance scale": "all distances of an instrument may have a common scale ({names})",
    "slope distance": "horizontal distances may be slope distances ({names})",
    "horizontal distance": "slope distances may be horizontal distances ({names})",
    "instrument height": "the height of an instrument may be wrong or forgotten ({names})",
    "target height": "the height of a target may be wrong or forgotten ({names})",
    "circle unit": "a circle may have been read in another unit ({names})",
    "circle sense": "a horizontal circle may count the other way ({names})",
    "elevation for zenith": "zenith angles may be elevations ({names})",
    "face": "directions may have been read in the other face ({names})",
    "image flipped": "image coordinates may count y the other way ({names})",
    "image turned": "an image may be turned by half a circle ({names})",
    "image unit": "image coordinates may be in another unit ({names})",
    "image scale": "the camera constant, or the size of the pixels, may be wrong ({names})",
    "levelling sign": "levelling lines may have the wrong sign ({names})",
    "table unit": "all lengths of a table may be in another unit ({names})",
    "vector sign": "vectors may have the wrong sign ({names})",
    "antenna height": "the antenna height at a point may be wrong or missing ({names})",
    "control moved": "a control point may have wrong coordinates, or have moved ({names})",
    "pixel origin": "the principal point, or the origin of the pixels, may be wrong ({names})",
    "camera of images": "images may be of another camera or focal length ({names})",
    "curvature": "the curvature of the earth is not modelled",
    "set-ups exchanged": "the places of two instruments may be exchanged ({names})",
    "images exchanged": "the names of two images may be exchanged ({names})",
    "orientation changed": "the horizontal circle may have been turned during a set of directions ({names})",
    "sigma of a table": "the standard deviations of a table may be wrong by one factor ({names})",
    "sigma unit": "standard deviations may be in another unit ({names})",
}
"""What each cause says."""


def hypothesis_section(solved: Solved, words: Words) -> str:
    """The possible causes, the best first, with a line to try each of them."""
    rows = possible_causes(solved)
    note = words(
        "These are tests without a further adjustment, not verified: run mor diagnose. "
        "Look at the measurements before you change anything."
    )
    return scored(rows, words, note) if rows else ""


def scored(rows: list[dict[str, Any]], words: Words = ENGLISH, note: str = "") -> str:
    """Possible causes, the best first."""
    lines = [
        heading(words("Possible causes")),
        note or words("These are tests without a further adjustment, not verified."),
    ]
    for number, row in enumerate(rows, 1):
        lines += [f"{number}. {sentence(row, words)}", f"   {decrease(row, words)}"]
        lines.append("   " + words("to try it: {line}", line=row["line"]))
    return "\n".join(lines)


def first_sentence(rows: list[dict[str, Any]], words: Words) -> list[str]:
    """The best possible cause, for the verdict."""
    return [
        words("Possible cause, not verified (run mor diagnose): {cause}.", cause=sentence(row, words))
        for row in rows[:1]
    ]


def decrease(row: dict[str, Any], words: Words) -> str:
    """State how a possible cause would change vᵀPv."""
    gain = words.number(short(abs(row["vtpv_decrease"]), 4))
    if row["vtpv_decrease"] < 0.0:
        return words("vTPv would increase by {gain}", gain=gain)
    return words("vTPv would decrease by {gain}", gain=gain)


def diagnosed(data: dict[str, Any], words: Words) -> str:
    """The result of a diagnosis: what is offered, and a table of what was tried."""
    before = data["vtpv_before"]
    lines = [
        words(
            "vTPv {before} ({freedom:degree|degrees} of freedom) without a change",
            before="-" if before is None else words.number(short(before, 5)),
            freedom=data["freedom_before"],
        )
    ]
    if not data["offered"]:
        lines.append(words("No hypothesis explains the observations."))
    for number, row in enumerate(data["offered"], 1):
        lines.append(f"{number}. {sentence(row, words)}")
        after, freedom = words.number(short(row["vtpv_after"], 5)), row["freedom_after"]
        lines.append("   " + words("vTPv {after} ({freedom:degree|degrees} of freedom)", after=after, freedom=freedom))
        if row["like_the_first"]:
            lines.append("   " + words("The observations cannot tell this from 1."))
        lines.append("   " + words("to try it: {line}", line=row["line"]))
        lines += _diff(row.get("diff"), words)
    if data["offered"]:
        lines.append(words("None is applied. Look at the measurements before you change anything."))
    if data["untried"]:
        said = "{count:hypothesis was|hypotheses were} not tried because the time limit was reached; --limit raises it."
        lines.append(words(said, count=data["untried"]))
    return "\n".join(lines)


def _diff(diff: str | None, words: Words) -> list[str]:
    lines = (diff or "").splitlines()
    # Lines of a diff that are printed; results as JSON have all of them.
    most = 24
    said = [f"     {line}" for line in lines[:most]]
    if len(lines) > most:
        said.append("     " + words("and {count:line|lines} more (--json has all)", count=len(lines) - most))
    return said


def tried(data: dict[str, Any], words: Words = ENGLISH) -> str:
    """Table of all hypotheses that were adjusted, in their order."""
    head = (words("hypothesis"), "vTPv", words("freedom"), words("gain"))
    rows = [
        (
            f"{words.listed(row['cause'])} ({', '.join(row['things'])})",
            "-" if row["vtpv_after"] is None else words.number(short(row["vtpv_after"], 5)),
            "-" if row["freedom_after"] is None else str(row["freedom_after"]),
            "-" if row["gain"] is None else words.number(short(row["gain"], 4)),
        )
        for row in data["tried"]
    ]
    widths = [max(len(line[k]) for line in (head, *rows)) for k in range(4)]
    return "\n".join(
        "  ".join([line[0].ljust(widths[0]), *(line[k].rjust(widths[k]) for k in (1, 2, 3))]) for line in (head, *rows)
    )


def sentence(row: dict[str, Any], words: Words = ENGLISH) -> str:
    """One hypothesis, with its amount where it has one."""
    said = words(SENTENCES[row["cause"]], names=", ".join(row["things"]))
    if row["amount"] is None:
        return said
    amount = row["amount"]
    return f"{said}: {words.listed(amount['name'])} {words.number(short(amount['value'], 6))} {amount['unit']}".rstrip()


# ---- Report observations left out because all together have no acceptable solution.


def suspect_section(solved: Solved, words: Words = ENGLISH, shown: int = 200) -> str:
    """The suspects, the worst first; nothing if there are none."""
    data = suspects(solved)
    if data is None:
        return ""
    rows = [[in_words(row, words), words.number(short(row["misfit"], 4))] for row in data["observations"][:shown]]
    lines = [
        heading(words("Left out: suspects of gross errors")),
        words(
            "Found with weights that fall to zero (gradually, down to 3 sigma). This report is the plain adjustment of "
            "all other observations; data snooping (--snoop) starts from it and puts back observations that fit."
        ),
        table(["observation", "|v| [sigma]"], rows, 1, words),
    ]
    if data["count"] > len(rows):
        lines.append(words("and {count} more in the table of residuals", count=data["count"] - len(rows)))
    return "\n".join(lines)


def sentences(data: dict[str, Any] | None, words: Words = ENGLISH) -> list[str]:
    """The verdict on them; first of all that not all observations have been adjusted."""
    if data is None:
        return []
    place = "; ".join(in_words(row, words) for row in data["observations"][:2])
    if data["outcome"] == Outcome.CONVERGED.value:
        return [
            words(
                "FITS BADLY if all observations are used (sigma0 ratio {ratio} after {count:iteration|iterations}).",
                ratio=words.number(short(data["sigma0_ratio"], 4)),
                count=data["iterations"],
            ),
            words(
                "Without {count:suspect|suspects} the others fit; what follows is that adjustment. The worst: {place}.",
                count=data["count"],
                place=place,
            ),
        ]
    return [
        words(
            "DOES NOT CONVERGE with all observations ({outcome} after {count:iteration|iterations}).",
            outcome=words.listed(data["outcome"]),
            count=data["iterations"],
        ),
        words(
            "Without {count:suspect|suspects} it does; what follows is that adjustment. The worst: {place}.",
            count=data["count"],
            place=place,
        ),
    ]


def emptied(groups: Sequence[dict[str, Any]], words: Words) -> list[str]:
    """Groups of which nothing takes part any more: what tests accept then says nothing about them."""
    said = "Nothing is left of {group}: all its observations were excluded ({count})."
    gone = [row for row in groups if row["observations"] == 0 and row["excluded"] > 0]
    return [words(said, count=row["excluded"], group=row["name"]) for row in gone]


# ---- Gross errors in words: suspicious observations, what was excluded, the robust comparison.

SHOWN_RELIABILITY = 40


def reliability_section(solved: Solved, words: Words = ENGLISH, shown: int = SHOWN_RELIABILITY) -> str:
    """Levels first, then each suspicious observation in one sentence."""
    data = gross_errors(solved)
    if not data:
        return ""
    unit = solved.network.project.units.length
    lines = [
        heading(words("Gross errors")),
        words(
            "Tests of single observations with alpha0 = {alpha}, beta0 = {beta} (delta0 squared = {delta}).",
            alpha=f"{summary(solved)['snooping_level']:.3g}",
            beta=f"{data['beta0']:.3g}",
            delta=f"{data['noncentrality']:.4f}",
        ),
    ]
    if data["familywise_level"] is not None:
        together = f"{data['familywise_level']:g}"
        lines.append(words("All of them together reject by mistake with {level} (Sidak).", level=together))
    flagged = [row for row in data["suspicious"] if row["flagged"]]
    if data["suspicious"]:
        lines.append(words("Flagged:") if flagged else words("Nothing is flagged. The largest test values:"))
    lines += [f"  {_sentence(row, unit, words)}" for row in (flagged or data["suspicious"])[:shown]]
    parts = (
        _fixed_points(solved, unit, words, shown),
        snooped_in_words(data["snooping"], words, shown),
        robust_in_words(data["robust"], unit, words, shown),
    )
    for part in parts:
        lines += ["", *part] if part else []
    return "\n".join(lines)


def _sentence(row: dict[str, Any], unit: str, words: Words) -> str:
    if row["point"] is not None and row["movement"] is None:
        sentence = "{place}: w = {w}, r = {r}: it is controlled too weakly to say anything about an error in it"
        return words(sentence, place=in_words(row, words), w=fixed(row["w"], 2), r=short(row["r"], 2))
    said = words(
        "{place}: w = {w}, r = {r}, estimated error {error} {unit}, smallest detectable {nabla}",
        place=in_words(row, words),
        w=fixed(row["w"], 2),
        r=fixed(row["r"], 2),
        error=short(row["error"], 3),
        unit=row["unit"],
        nabla=short(row["nabla"], 3),
    )
    if row["point"] is None:
        return said + words("; it moves no free point")
    size = [abs(x) for x in row["movement"]]
    axis = size.index(max(size))
    return said + words(
        "; would move {point} by {amount} {unit} in {axis}",
        point=row["point"],
        amount=fixed(row["movement"][axis], DIGITS[unit]),
        unit=unit,
        axis="XYZ"[axis],
    )


def _fixed_points(solved: Solved, unit: str, words: Words, shown: int) -> list[str]:
    tests = fixed_point_rows(solved)
    alpha = solved.quality.levels.snooping if solved.quality is not None else 0.0
    moved = sorted((row for row in tests if row["p"] < alpha), key=lambda row: -row["test"])
    if not moved:
        return []
    d = DIGITS[unit]
    lines = [words("The observations contradict these fixed coordinates (level {level}):", level=f"{alpha:.3g}")]
    for row in moved[:shown]:
        where = ", ".join(f"{name} {words.number(fixed(x, d))}" for name, x in zip("XYZ", row["movement"], strict=True))
        said = "  {id}: moved by {where} {unit}? T = {test}, p = {p}"
        lines.append(words(said, id=row["id"], where=where, unit=unit, test=short(row["test"], 4), p=f"{row['p']:.2g}"))
    return lines


def snooped_in_words(data: dict[str, Any] | None, words: Words, shown: int) -> list[str]:
    """State what data snooping removed and reinstated; empty if it was not requested."""
    if data is None:
        return []
    out = sum(step["action"] == "excluded" for step in data["steps"])
    back = len(data["steps"]) - out
    lines = [heading(words("Data snooping: {out} excluded, {back} put back", out=out, back=back))]
    if not data["clean"]:
        lines.append(words("NOT CLEAN: flagged observations remain that were not excluded."))
    lines += mostly_out_in_words(data["mostly_out"], words, shown)
    rows = [
        [str(step["round"]), step["action"], in_words(step, words), fixed(step["w"], 2)]
        for step in data["steps"][: 5 * shown]
    ]
    if rows:
        lines.append(table(["round", "action", "observation", "w [1]"], rows, 3, words))
    if len(data["steps"]) > len(rows):
        lines.append(words("and {count} more in results.json", count=len(data["steps"]) - len(rows)))
    return lines


def mostly_out_in_words(rows: list[dict[str, Any]], words: Words, shown: int) -> list[str]:
    """One sentence on everything of which most observations were taken out, by name the first ones."""
    if not rows:
        return []
    said = "{thing} {id} ({out} of {count})"
    named = [
        words(said, thing=words(row["of"]), id=row["id"], out=row["excluded"], count=row["observations"])
        for row in rows
    ]
    advice = (
        "Most observations of {things} were excluded: check whether the whole is wrong (name, given values, a moved "
        "instrument) rather than each observation."
    )
    return [words(advice, things=enumerated(named, shown, words))]


def robust_in_words(data: dict[str, Any] | None, unit: str, words: Words, shown: int) -> list[str]:
    """State what the robust solution rejects and how points move; empty if it was not requested."""
    if data is None:
        return []
    d = DIGITS[unit]
    lines = [
        heading(words("Robust estimation ({method}) beside least squares", method=data["method"])),
        words(
            "{count:observation hardly counts|observations hardly count}; points differ by {rms} {unit} "
            "(root mean square), {largest} {unit} at most.",
            count=len(data["rejected"]),
            rms=fixed(data["rms_shift"], d),
            unit=unit,
            largest=fixed(data["largest_shift"], d),
        ),
    ]
    lines += [f"  {in_words(row, words)}" for row in data["rejected"][:shown]]
    if len(data["rejected"]) > shown:
        lines.append(words("  and {count} more", count=len(data["rejected"]) - shown))
    return lines


# ---- Report undetermined unknowns, with hints.

SHOWN_UNDETERMINED = 1000
"""Things a text report lists; the table beside it has all."""


def undetermined_section(solved: Solved, words: Words) -> str:
    """Explanation of a singular system, or of directions that are hardly determined; nothing otherwise."""
    weak = weakness(solved, words)
    if weak:
        return "\n".join([heading(words("Poorly determined")), *weak])
    if solved.adjustment.reason in (AT_THE_START, PUT_ANYWHERE):
        return ""  # what is singular there is so because of where things were put
    if solved.adjustment.outcome is not Outcome.SINGULAR:
        turned = [] if solved.quality is not None else turned_about(solved, words)
        return "\n".join([heading(words("Poorly determined")), *turned]) if turned else ""
    lines = _named(solved, words)
    if not lines:
        misfit = solved.adjustment.normals.objective / max(solved.adjustment.problem.observations, 1)
        doubt = (
            "This was found at values that do not fit the observations (sigma0 ratio {ratio}): wrong observations, "
            "coordinates or start values may be the cause."
        )
        lines = [words(doubt, ratio=f"{misfit**0.5:.3g}")] if misfit > ABSURD else []
        lines += explain_singularity(solved, words)
    return "\n".join([heading(words("Not determined")), *lines])


def _named(solved: Solved, words: Words) -> list[str]:
    """A line for each of very many things, which were found before the adjustment and took no part in it."""
    if solved.adjustment.defect.undetermined:
        return []
    things = [thing for thing in solved.network.undeterminable if not thing.treatment]
    return [f"{words.listed(one.kind)} {one.name}: {words.told(one.reason)}" for one in things[:SHOWN_UNDETERMINED]]


def listed(solved: Solved, words: Words = ENGLISH, shown: int = SHOWN_UNDETERMINED) -> str:
    """Return the unknowns that were left out, are at infinity, or stop the adjustment."""
    things = solved.network.undeterminable
    if not things:
        return ""
    rows = [
        [
            words.listed(thing.kind),
            thing.name,
            words.listed(thing.treatment) if thing.treatment else "-",
            words.told(thing.reason),
        ]
        for thing in things[:shown]
    ]
    headers = ["object", "id", "treatment", "reason"]
    lines = [heading(words("Undetermined objects")), table(headers, rows, 4, words)]
    if len(things) > shown:
        lines.append(words("{count} more are in undetermined.csv.", count=len(things) - shown))
    return "\n".join(lines)


def sentences_of_things(things: Sequence[UndeterminedObject], words: Words) -> list[str]:
    """Count the undetermined unknowns, name the first, and say where all of them are listed."""
    left = [thing for thing in things if thing.treatment == "left out"]
    far = [thing for thing in things if thing.treatment == "at infinity"]
    lines = []
    if left:
        said = "{count:object is|objects are} LEFT OUT because nothing determines them: {names} (undetermined.csv)."
        lines.append(words(said, count=len(left), names=named(left, words)))
    if far:
        lines.append(words("At infinity, with a direction only: {names} (undetermined.csv).", names=named(far, words)))
    return lines


def named(things: Sequence[UndeterminedObject], words: Words) -> str:
    """The first five, and how many there are more."""
    return enumerated([f"{words.listed(thing.kind)} {thing.name}" for thing in things], 5, words)


# ---- The report where there is no solution: the iterations, what does not come to rest, what fits worst.


def unsettled_section(solved: Solved, words: Words = ENGLISH, shown: int = SHOWN_RELIABILITY) -> str:
    """Iterations, movements and misfits; nothing if there is a solution."""
    if solved.quality is not None:
        return ""
    parts = [
        _iterations(solved, words),
        _moving(solved, words),
        _worst(solved, words, shown),
        heading(words("NOT A SOLUTION: all values below are those of the last iteration")),
    ]
    return "\n\n".join(part for part in parts if part)


def _iterations(solved: Solved, words: Words) -> str:
    columns = "number objective:.7g sigma0:.5g largest_change:.3g damping:.3g"
    rows = [cells({**step._asdict(), "sigma0": step.sigma0}, columns) for step in solved.adjustment.iterations]
    if not rows:
        return ""
    headers = ["no.", "vTPv [1]", "sigma0 ratio [1]", "largest change [sigma]", "damping"]
    return "\n".join([heading(words("Iterations")), table(headers, rows, words=words)])


def _moving(solved: Solved, words: Words) -> str:
    rows = [
        [
            f"{words.listed(row['of'])} {row['id']}",
            row["component"],
            row["unit"],
            words.listed(row["way"]),
            " ".join(words.number(short(step, 3)) for step in row["steps"]),
        ]
        for row in moving_rows(solved)
    ]
    if not rows:
        return ""
    headers = ["unknown", "component", "unit", "way", "last steps"]
    return "\n".join([heading(words("Unknowns that do not settle")), table(headers, rows, 4, words)])


def _worst(solved: Solved, words: Words, shown: int) -> str:
    rows = []
    for row in worst_misfits(solved, shown).to_dicts():
        numbers = cells(row, "component unit observed:.9g v:.4g sigma:.3g misfit:.1f")
        rows.append([row["type"], " ".join(part for part in (row["at"], row["from"], row["to"]) if part), *numbers])
    if not rows:
        return ""
    headers = ["type", "between", "component", "unit", "observed", "v", "sigma", "|v|/sigma"]
    title = heading(words("Largest misfits at the last values (no solution, so v is not a residual)"))
    return "\n".join([title, table(headers, rows, 4, words)])
