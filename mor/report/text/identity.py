"""What the report is of, and who signs it: the last section."""

from __future__ import annotations

from typing import Any

from mor.report.layout import heading
from mor.report.words.language import ENGLISH, Words

LINE = "_" * 30


def persons(identity: dict[str, Any], words: Words = ENGLISH) -> list[tuple[str, str]]:
    """Who and when, for the head; what the project does not say is left out."""
    rows = [(key, identity[key] or "") for key in ("client", "operator", "date", "remarks")]
    rows = [("date of the data" if key == "date" else key, text) for key, text in rows if text]
    return [(words(name), " ".join(text.split())) for name, text in rows]


def section(identity: dict[str, Any], words: Words = ENGLISH) -> str:
    """Program, options, input files with their SHA-256, and the place for the signature."""
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
    lines += [
        "",
        "",
        f"{LINE}    {LINE}",
        f"{words('place and date').ljust(len(LINE))}    {words('signature')}",
    ]
    return "\n".join(lines)
