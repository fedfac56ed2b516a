"""Results of domains beside those of one adjustment of everything."""

from __future__ import annotations

import json
from math import isclose
from pathlib import Path
from typing import Any

import pytest

from mor.domains import room
from mor.report.results.models.model import Results
from tests.scenarios.domains_blocks import Ended, Kind, command, write_block

NAMES = (
    ("id",),
    ("type", "group", "at", "from", "to", "component"),
    ("of", "name"),
    ("name", "type"),
    ("group", "component"),
    ("type", "names", "component"),
)
"""Keys by which rows of a list are told apart."""


def have_small_domains(monkeypatch: pytest.MonkeyPatch, rays: int = 700) -> None:
    """Let every project be adjusted in domains, of so many image points."""
    monkeypatch.setattr(room, "rays_of_domain", lambda all_rays, memory, workers=1: rays)
    monkeypatch.setattr(room, "need_of_all", lambda all_rays, html=None, snooping=False: 1e18)
    monkeypatch.setattr(room, "PROGRAM", 0.0)
    monkeypatch.setattr(room, "OF_OUTER", 0)


def results(folder: Path) -> dict[str, Any]:
    data: dict[str, Any] = json.loads((folder / "results.json").read_text(encoding="utf-8"))
    Results.model_validate(data)
    return data


def both(tmp_path: Path, kind: Kind, seed: int = 1, **changed: str) -> tuple[dict[str, Any], dict[str, Any]]:
    """Results of one adjustment of everything, and of domains; texts of the project are ``changed``."""
    project = write_block(tmp_path / "block", kind, seed)
    text = project.read_text(encoding="utf-8")
    for before, after in changed.items():
        assert before in text
        text = text.replace(before, after)
    project.write_text(text, encoding="utf-8")
    for folder, options in (("one", ()), ("several", ("--memory", "400MB"))):
        done: Ended = command("adjust", project, "-o", tmp_path / folder, *options)
        assert done.exit_code == 0, done.stderr
    return results(tmp_path / "one"), results(tmp_path / "several")


def named(rows: list[Any]) -> dict[str, Any] | None:
    """Rows by what tells them apart."""
    if not rows or not isinstance(rows[0], dict):
        return None
    keys = next((keys for keys in NAMES if all(key in rows[0] for key in keys)), None)
    return {json.dumps([row[key] for key in keys], sort_keys=True): row for row in rows} if keys else None


def differences(one: Any, other: Any, path: str = "") -> list[str]:
    """Places where two results differ, numbers by more than a millionth.

    Domains neither judge determination nor look for what flagged observations have in common.
    """
    if path.endswith(("verdict/determined", "/in_common")) or path == "/files":
        return []
    if isinstance(one, dict) and isinstance(other, dict):
        lost = [f"{path}/{key} in one only" for key in one.keys() ^ other.keys()]
        return lost + [
            line
            for key in one.keys() & other.keys()
            for line in differences(one[key], other[key], f"{path}/{key}")
        ]
    if isinstance(one, list) and isinstance(other, list):
        if (here := named(one)) is not None and (there := named(other)) is not None:
            return differences(here, there, path)
        long = [f"{path}: {len(one)} and {len(other)}"] if len(one) != len(other) else []
        pairs = enumerate(zip(one, other, strict=False))
        return long + [line for k, (a, b) in pairs for line in differences(a, b, f"{path}/{k}")]
    if isinstance(one, float) and isinstance(other, float):
        same = isclose(one, other, rel_tol=1e-6, abs_tol=1e-9)
    else:
        same = one == other
    return [] if same else [f"{path}: {one} and {other}"]


ELSEWHERE = ("identity", "notes", "iteration_log", "files")
"""Order of the files read; what domains note; other unknowns hold a free datum; domains write a file of their own."""
