"""Last section of the report: inputs, program, signature."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

from mor.errors import MOST_TOLD
from mor.report.layout import heading
from mor.report.words.language import ENGLISH, Words

LINE = "_" * 30


def persons(identity: dict[str, Any], words: Words = ENGLISH) -> list[tuple[str, str]]:
    """Who and when, for the head; what the project does not say is left out."""
    rows = [(key, identity[key] or "") for key in ("client", "operator", "measured", "date", "remarks")]
    rows = [("input as of" if key == "date" else key, text) for key, text in rows if text]
    return [(words(name), " ".join(text.split())) for name, text in rows]


def section(
    identity: dict[str, Any],
    words: Words = ENGLISH,
    notes: Sequence[dict[str, Any]] = (),
    shown: int = MOST_TOLD,
) -> str:
    """Program, options, input files with their SHA-256, what was noted of them, and the place for the signature."""
    rows = [
        (words("program"), identity["program"]),
        (words("options"), " ".join(identity["options"]) or words("none")),
    ]
    width = max(len(name) for name, _ in rows)
    lines = [heading(words("About this report")), *(f"{name.ljust(width)}  {text}" for name, text in rows)]
    if identity["inputs"]:
        lines += ["", words("Read from ({count:file|files}), with SHA-256:", count=len(identity["inputs"]))]
    for file in identity["inputs"]:
        said = words("{count:byte|bytes}", count=file["bytes"])
        lines += [f"  {file['file']}, {said}", f"    {file['sha256']}"]
    if notes:
        lines += ["", f"{words('Notes on what was read')}:", *(_note(row, words) for row in notes[:shown])]
    if len(notes) > shown:
        more = len(notes) - shown
        lines.append(words("{count:more note stands|more notes stand} in results.json.", count=more))
    lines += [
        "",
        "",
        f"{LINE}    {LINE}",
        f"{words('place and date').ljust(len(LINE))}    {words('signature')}",
    ]
    return "\n".join(lines)


def _note(row: dict[str, Any], words: Words) -> str:
    line = f":{row['line']}" if row["line"] else ""
    place = f"{row['file']}{line}: " if row["file"] else ""
    return f"  {place}{words.told(row['message'])}"
