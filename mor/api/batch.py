"""Many projects: which they are, where their results go, and what is said of each."""

from __future__ import annotations

import json
import os
from collections.abc import Iterable
from glob import glob
from pathlib import Path
from typing import Any, NamedTuple

from mor.api.workers import Done
from mor.errors import ExitCode, InputError, Message
from mor.report.batch import BatchRow
from mor.report.comparison import differences, said_value

_STATUS = {
    ExitCode.INPUT: "input",
    ExitCode.NOT_CONVERGED: "not converged",
    ExitCode.SINGULAR: "singular",
    ExitCode.MEMORY: "memory",
    ExitCode.INTERNAL: "internal error",
}
LOG = "log.txt"
RESULTS = "results.json"


class Case(NamedTuple):
    """A project of a batch, its name in all tables, and the folder of its results."""

    name: str
    project: Path
    folder: Path


def cases(patterns: Iterable[str], output: Path) -> list[Case]:
    """The projects that patterns stand for, each once, by name. Raises :class:`InputError` for those of nothing.

    ``**`` stands for any number of folders. A project is called as its path from what all have in common, without
    ``project.yaml``.
    """
    problems, found, there = [], dict[Path, None](), Path(os.path.realpath(output))
    for pattern in patterns:
        paths = [Path(path) for path in sorted(glob(pattern, recursive=True))]
        here = [path for path in paths if path.is_file() and there not in path.resolve().parents]
        if not here:
            problems.append(Message("no project file matches this name", pattern))
        found |= dict.fromkeys(here)
    if problems:
        raise InputError(problems)
    common = Path(os.path.commonpath([path.resolve().parent for path in found]))
    named: dict[str, Path] = {}
    for path in found:
        name = _name(path.resolve().relative_to(common))
        if name in named:
            problems.append(Message(f"two projects would have the name {name!r}: this and {named[name]}", str(path)))
        named[name] = path
    if problems:
        raise InputError(problems)
    return [Case(name, path, output / name) for name, path in sorted(named.items())]


def _name(path: Path) -> str:
    """``blocks/a`` for blocks/a/project.yaml, ``blocks/net`` for blocks/net.yaml."""
    named = path.parent if path.name == "project.yaml" and path.parent != Path() else path.with_suffix("")
    return named.as_posix()


def stamp(case: Case) -> tuple[int, int] | None:
    """Return a digest of the results of a project, or ``None`` if there are none."""
    try:
        status = (case.folder / RESULTS).stat()
    except OSError:
        return None
    return status.st_ino, status.st_mtime_ns


def row_of(case: Case, done: Done, is_new: bool, against: Path | None, tolerance: float) -> BatchRow:
    """Return the row of a project, from its exit code and from results that this run has written."""
    content = _content(case.folder / RESULTS) if done.code is not None and is_new else None
    row = _row(case, done, content)
    if against is None:
        return row
    kept = _content(against / case.name / RESULTS)
    if kept is None:
        return row._replace(differences=-1, first="no kept results")
    if content is None:
        return row._replace(differences=-1, first="no results to compare")
    found = differences(kept, content, tolerance)
    first = f"{found[0].place}: {said_value(found[0].one)} | {said_value(found[0].other)}" if found else ""
    return row._replace(differences=len(found), first=first)


def _row(case: Case, done: Done, content: dict[str, Any] | None) -> BatchRow:
    if done.code is None:
        status = "timed out" if done.death.startswith("ended") else "crashed"
        return BatchRow(case.name, status, None, done.death, done.seconds)
    reason = _last_line(case.folder / LOG) if content is None else str(content["reason"] or "")
    status = _STATUS.get(ExitCode(done.code) if done.code in set(ExitCode) else ExitCode.INTERNAL, "")
    if content is None or not content["solution"]:
        return BatchRow(case.name, status or "no results", done.code, reason, done.seconds)
    accepted = content["redundancy"] == 0 or content["global_test"]["accepted"]
    status = "suspects left out" if content.get("suspects") and done.code else "" if accepted else "rejected"
    status = status or ("flagged" if content["flagged"] else "accepted")
    counts = {key: content[key] for key in ("observations", "unknowns", "redundancy", "flagged", "uncontrolled")}
    sigma0 = content["sigma0"]["ratio_of_sigmas"]
    return BatchRow(case.name, status, done.code, "", done.seconds, sigma0=sigma0, **counts)


def _content(path: Path) -> dict[str, Any] | None:
    try:
        content = json.loads(path.read_text(encoding="utf-8"))
    except (OSError, ValueError):
        return None
    return content if isinstance(content, dict) else None


def _last_line(log: Path) -> str:
    try:
        lines = log.read_text(encoding="utf-8", errors="replace").splitlines()
    except OSError:
        return ""
    told = [line for line in lines if line.strip() and not line.startswith("note: ")]
    return told[0] if told else ""
