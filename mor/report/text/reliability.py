"""Gross errors in words: suspicious observations, what was excluded, the robust comparison."""

from __future__ import annotations

from typing import Any

from mor.quality.solved import Solved
from mor.report.layout import DIGITS, fixed, heading, in_words, short, table
from mor.report.results.summary import summary
from mor.report.tables.reliability import fixed_point_rows, gross_errors
from mor.report.words.language import ENGLISH, Words

SHOWN = 40


def section(solved: Solved, words: Words = ENGLISH, shown: int = SHOWN) -> str:
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
        return words(
            "{place}: w = {w}, r = {r}: so little else controls it that nothing can be said of an error in it",
            place=in_words(row, words),
            w=fixed(row["w"], 2),
            r=short(row["r"], 2),
        )
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
    """Fixed points that the observations would rather have elsewhere."""
    tests = fixed_point_rows(solved)
    alpha = solved.quality.levels.snooping if solved.quality is not None else 0.0
    moved = sorted((row for row in tests if row["p"] < alpha), key=lambda row: -row["test"])
    if not moved:
        return []
    d = DIGITS[unit]
    lines = [
        words("The observations contradict these fixed coordinates (level {level}):", level=f"{alpha:.3g}")
    ]
    for row in moved[:shown]:
        where = ", ".join(
            f"{name} {words.number(fixed(x, d))}" for name, x in zip("XYZ", row["movement"], strict=True)
        )
        lines.append(
            words(
                "  {id}: moved by {where} {unit}? T = {test}, p = {p}",
                id=row["id"],
                where=where,
                unit=unit,
                test=short(row["test"], 4),
                p=f"{row['p']:.2g}",
            )
        )
    return lines


def snooped_in_words(data: dict[str, Any] | None, words: Words, shown: int = SHOWN) -> list[str]:
    """State what data snooping removed and reinstated; empty if it was not requested."""
    if data is None:
        return []
    out = sum(step["action"] == "excluded" for step in data["steps"])
    back = len(data["steps"]) - out
    lines = [heading(words("Data snooping: {out} excluded, {back} put back", out=out, back=back))]
    if not data["clean"]:
        lines.append(words("NOT CLEAN: something is still flagged that was not excluded."))
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
    named = ", ".join(
        words(
            "{thing} {id} ({out} of {count})",
            thing=words(row["of"]),
            id=row["id"],
            out=row["excluded"],
            count=row["observations"],
        )
        for row in rows[:shown]
    )
    left = len(rows) - shown
    if left > 0:
        named = words("{names} and {count} more", names=named, count=left)
    return [
        words(
            "Most observations were taken out of {things}: is not rather the whole wrong (name, given values, a frame "
            "that moved) than each of them?",
            things=named,
        )
    ]


def robust_in_words(data: dict[str, Any] | None, unit: str, words: Words, shown: int = SHOWN) -> list[str]:
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
