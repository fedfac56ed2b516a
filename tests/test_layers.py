"""The architecture: imports point only downwards, there is no circle, and there are two levels of folders."""

from __future__ import annotations

import ast
from pathlib import Path

import mor

ROOT = Path(mor.__file__).parent
ORDER = (
    {"errors", "units", "types"},
    {"input_files", "machine"},
    {"output_files", "long_arrays"},
    {"model"},
    {"project"},
    {"linalg"},
    {"solve"},
    {"start"},
    {"quality"},
    {"diagnose"},
    {"plan"},
    {"report"},
    {"formats"},
    {"api"},
    {"cli"},
)
"""Bottom to top."""
LEVEL = {name: level for level, names in enumerate(ORDER) for name in names}
FORBIDDEN = {("linalg", "model"), ("linalg", "project"), ("solve", "project")}
"""Downwards, and still not allowed: linear algebra knows no geodesy, and the solver works without a project file."""
MODULES = {
    ".".join(("mor", *path.relative_to(ROOT).with_suffix("").parts)).removesuffix(".__init__"): path
    for path in ROOT.rglob("*.py")
}
SIDES = {"mor", "mor.__main__"}


def _imports(path: Path) -> set[str]:
    """Return the modules of mor that a module imports anywhere in its code."""
    found = set()
    for node in ast.walk(ast.parse(path.read_text(encoding="utf-8"))):
        if isinstance(node, ast.Import):
            found |= {alias.name for alias in node.names}
        elif isinstance(node, ast.ImportFrom):
            assert node.level == 0, f"{path}: relative import"
            full = {f"{node.module}.{alias.name}" for alias in node.names}
            found |= (full & MODULES.keys()) or {str(node.module)}
    return found & (MODULES.keys() - SIDES)


GRAPH = {name: _imports(path) for name, path in MODULES.items() if name not in SIDES}


def test_imports_point_only_downwards() -> None:
    pairs = [(a, b, a.split(".")[1], b.split(".")[1]) for a, found in GRAPH.items() for b in sorted(found)]
    wrong = [(a, b) for a, b, x, y in pairs if x != y and (LEVEL[y] >= LEVEL[x] or (x, y) in FORBIDDEN)]
    assert wrong == []


def test_there_is_no_circle_of_imports() -> None:
    left = dict(GRAPH)
    while free := {name for name, found in left.items() if not (found & left.keys()) - {name}}:
        left = {name: found for name, found in left.items() if name not in free}
    assert sorted(left) == []


def test_there_are_two_levels_of_folders() -> None:
    depth = {name: path.relative_to(ROOT).parts for name, path in MODULES.items()}
    assert [n for n, parts in depth.items() if len(parts) > 2 + (parts[0] == "formats")] == []
