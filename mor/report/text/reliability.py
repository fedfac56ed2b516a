"""Gross errors in words: suspicious observations, what was excluded, the robust comparison."""

from __future__ import annotations

from typing import Any

from mor.quality.solved import Solved
from mor.report.reliability import fixed_point_rows, gross_errors
from mor.report.text._layout import DIGITS, fixed, heading, short, table

SHOWN = 40


def section(solved: Solved) -> str:
    """Levels first, then each suspicious observation in one sentence."""
    data = gross_errors(solved)
    if not data:
        return ""
    unit = solved.network.project.units.length
    level = f"alpha0 = {data['alpha0']:.3g}, beta0 = {data['beta0']:.3g}"
    lines = [
        heading("Gross errors"),
        f"Tests of single observations with {level} (delta0 squared = {data['noncentrality']:.4f}).",
    ]
    if data["familywise_level"] is not None:
        lines.append(f"All of them together reject by mistake with {data['familywise_level']:g} (Sidak).")
    flagged = [row for row in data["suspicious"] if row["flagged"]]
    if data["suspicious"]:
        lines.append("Flagged:" if flagged else "Nothing is flagged. The largest test values:")
    lines += [f"  {_sentence(row, unit)}" for row in (flagged or data["suspicious"])[:SHOWN]]
    parts = (_fixed_points(solved, unit), _snooping(data["snooping"]), _robust(data["robust"], unit))
    for part in parts:
        lines += ["", *part] if part else []
    return "\n".join(lines)


def _sentence(row: dict[str, Any], unit: str) -> str:
    words = (
        f"{_place(row)}: w = {fixed(row['w'], 2)}, r = {fixed(row['r'], 2)}, "
        f"estimated error {short(row['error'], 3)} {row['unit']}, smallest detectable {short(row['nabla'], 3)}"
    )
    if row["point"] is None:
        return f"{words}; it moves no free point"
    size = [abs(x) for x in row["movement"]]
    axis = size.index(max(size))
    amount = f"{row['movement'][axis]:.{DIGITS[unit]}f} {unit} in {'XYZ'[axis]}"
    return f"{words}; would move {row['point']} by {amount}"


def _place(row: dict[str, Any]) -> str:
    names = ", ".join(f"{key} {name}" for key, name in row["names"].items())
    return f"{row['type']} {names}, {row['component']}"


def _fixed_points(solved: Solved, unit: str) -> list[str]:
    """Fixed points that the observations would rather have elsewhere."""
    tests = fixed_point_rows(solved)
    alpha = solved.quality.levels.snooping if solved.quality is not None else 0.0
    moved = sorted((row for row in tests if row["p"] < alpha), key=lambda row: -row["test"])
    if not moved:
        return []
    d = DIGITS[unit]
    lines = [f"The observations contradict these fixed coordinates (level {alpha:.3g}):"]
    for row in moved[:SHOWN]:
        where = ", ".join(f"{name} {fixed(x, d)}" for name, x in zip("XYZ", row["movement"], strict=True))
        lines.append(
            f"  {row['id']}: moved by {where} {unit}? T = {short(row['test'], 4)}, p = {row['p']:.2g}"
        )
    return lines


def _snooping(data: dict[str, Any] | None) -> list[str]:
    if data is None:
        return []
    out = sum(step["action"] == "excluded" for step in data["steps"])
    back = len(data["steps"]) - out
    lines = [heading(f"Data snooping: {out} excluded, {back} put back")]
    if not data["clean"]:
        lines.append("NOT CLEAN: something that is still flagged could not be excluded.")
    rows = [
        [str(step["round"]), step["action"], _place(step), fixed(step["w"], 2)]
        for step in data["steps"][: 5 * SHOWN]
    ]
    if rows:
        lines.append(table(["round", "action", "observation", "w [1]"], rows, left=3))
    if len(data["steps"]) > len(rows):
        lines.append(f"and {len(data['steps']) - len(rows)} more in results.json")
    return lines


def _robust(data: dict[str, Any] | None, unit: str) -> list[str]:
    if data is None:
        return []
    d = DIGITS[unit]
    lines = [
        heading(f"Robust estimation ({data['method']}) beside least squares"),
        f"{len(data['rejected'])} observations hardly count; points differ by {fixed(data['rms_shift'], d)} {unit} "
        f"(root mean square), {fixed(data['largest_shift'], d)} {unit} at most.",
    ]
    lines += [f"  {_place(row)}" for row in data["rejected"][:SHOWN]]
    if len(data["rejected"]) > SHOWN:
        lines.append(f"  and {len(data['rejected']) - SHOWN} more")
    return lines
