"""The architecture: imports point only downwards, and there is no circle of imports."""

from __future__ import annotations

import ast
from collections.abc import Iterator
from pathlib import Path

import pytest

import mor

ROOT = Path(mor.__file__).parent
MODULES = sorted(ROOT.rglob("*.py"))

LAYERS = (
    ("escapes", "registers_in_numba"),
    ("errors", "units", "compilation", "counting", "arrays"),
    ("registers",),
    ("sparse",),
    ("geometry", "input_files", "machine"),
    ("parameters", "cluster", "output_files", "long_arrays"),
    ("observations",),
    ("project",),
    ("approximate", "adjustment"),
    ("quality",),
    ("diagnose",),
    ("report", "formats"),
    ("preparation",),
    ("pipeline",),
    ("planning",),
    ("api",),
    ("cli",),
)
"""Bottom to top; what stands in one layer does not know each other."""
LEVEL = {name: level for level, layer in enumerate(LAYERS) for name in layer}
FORBIDDEN = {("adjustment", "project")}
"""Downwards, and still not allowed: the solver works without a project file."""
FRONT = {"api", "errors"}
"""What ``import mor`` offers, and loads when it is asked for."""
NAMES = {
    ".".join(("mor", *m.relative_to(ROOT).with_suffix("").parts)).removesuffix(".__init__"): m
    for m in MODULES
}


def _part(module: Path) -> str:
    """``adjustment`` for mor/adjustment/solve.py, ``pipeline`` for mor/pipeline.py."""
    return module.relative_to(ROOT).parts[0].removesuffix(".py")


def _imports(source: str, package: tuple[str, ...]) -> Iterator[tuple[str, int]]:
    """Part of mor and line of every import, wherever it stands; ``package`` is what relative imports count from."""
    for node in ast.walk(ast.parse(source)):
        if isinstance(node, ast.Import):
            names = [alias.name for alias in node.names]
        elif isinstance(node, ast.ImportFrom):
            base = list(package[: len(package) - node.level + 1]) if node.level else []
            base += node.module.split(".") if node.module else []
            names = [".".join(base)] if len(base) > 1 else [".".join([*base, a.name]) for a in node.names]
        else:
            continue
        for name in names:
            parts = name.split(".")
            if parts[0] == "mor" and len(parts) > 1:
                yield parts[1], node.lineno


def _offence(importer: str, imported: str) -> str | None:
    if imported not in LEVEL:
        return None if imported.startswith("__") else f"{imported} belongs to no layer"
    if importer == imported or importer == "__main__":
        return None
    if importer == "__init__":
        return None if imported in FRONT else f"mor itself must not import {imported}"
    if importer not in LEVEL:
        return f"{importer} belongs to no layer"
    if LEVEL[imported] >= LEVEL[importer]:
        return f"{importer} must not import {imported}"
    return f"{importer} must not import {imported}" if (importer, imported) in FORBIDDEN else None


def _offences(module: Path) -> list[str]:
    package = ("mor", *module.relative_to(ROOT).parent.parts)
    found = ((line, _offence(_part(module), part)) for part, line in _imports(module.read_text(), package))
    return [f"line {line}: {offence}" for line, offence in found if offence]


def test_imports_point_only_downwards():
    assert [f"{m.relative_to(ROOT)}, {offence}" for m in MODULES for offence in _offences(m)] == []


@pytest.mark.parametrize(
    ("source", "parts"),
    [
        ("import mor.cli.main", ["cli"]),
        ("import numpy, mor.units as u", ["units"]),
        ("from mor.project import model", ["project"]),
        ("from mor import pipeline, units", ["pipeline", "units"]),
        ("def f():\n    from mor.quality.assess import assess", ["quality"]),
        ("from . import solve", ["adjustment"]),
        ("from ..project.model import Project", ["project"]),
        ("from .. import report", ["report"]),
        ("import mor", []),
        ("from moritz import cli", []),
    ],
)
def test_every_form_of_import_is_seen(source, parts):
    assert [part for part, _ in _imports(source, ("mor", "adjustment"))] == parts


@pytest.mark.parametrize(
    ("importer", "imported", "allowed"),
    [
        ("adjustment", "observations", True),
        ("adjustment", "adjustment", True),
        ("adjustment", "project", False),
        ("approximate", "project", True),
        ("approximate", "adjustment", False),
        ("adjustment", "approximate", False),
        ("observations", "adjustment", False),
        ("cli", "pipeline", True),
        ("pipeline", "cli", False),
        ("__init__", "cli", False),
        ("report", "formats", False),
        ("geometry", "utils", False),
    ],
)
def test_what_is_allowed(importer, imported, allowed):
    assert (_offence(importer, imported) is None) == allowed


def test_every_part_of_the_program_belongs_to_a_layer():
    assert {_part(module) for module in MODULES} - {"__init__", "__main__"} <= set(LEVEL)


def _imported_modules(module: Path) -> set[str]:
    """Modules below mor that a module imports where it is loaded, or later; mor itself imports nothing at once."""
    found = set()
    for node in ast.walk(ast.parse(module.read_text())):
        if isinstance(node, ast.ImportFrom) and node.module and node.module.split(".")[0] == "mor":
            within = {f"{node.module}.{alias.name}" for alias in node.names} & NAMES.keys()
            found |= within or {node.module}
    return (found & NAMES.keys()) - {"mor"}


def test_there_is_no_circle_of_imports():
    open_, done = [], set()

    def circle_from(name: str) -> list[str]:
        if name in open_:
            return [*open_[open_.index(name) :], name]
        if name in done:
            return []
        open_.append(name)
        found = next((c for other in sorted(_imported_modules(NAMES[name])) if (c := circle_from(other))), [])
        open_.pop()
        done.add(name)
        return found

    assert next((c for name in NAMES if name != "mor" and (c := circle_from(name))), []) == []
