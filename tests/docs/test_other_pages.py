"""Pages about results, exit codes and new types: they say what the program does."""

from __future__ import annotations

import json
import re
from importlib import import_module
from pathlib import Path

import numpy as np
import pytest

from mor.cli import ENDED, INTERRUPTED, LEFT
from mor.errors import ExitCode
from mor.report.observations import SCHEMA
from tests.scenarios.small_projects import mor, write_block

ROOT = Path(__file__).parents[2]
DOCS = ROOT / "docs"
PAGES = sorted(
    [
        *DOCS.rglob("*.md"),
        *(ROOT / "sample_projects").glob("**/README.md"),
        ROOT / "README.md",
        ROOT / "CHANGELOG.md",
    ]
)


def text(name: str) -> str:
    return (DOCS / name).read_text(encoding="utf-8")


def test_exit_codes_are_those_of_the_program() -> None:
    documented = {int(code) for code in re.findall(r"^\| (\d+) \|", text("exit-codes.md"), re.M)}
    assert documented == {*map(int, ExitCode), INTERRUPTED, ENDED, LEFT}


@pytest.mark.parametrize("column", SCHEMA)
def test_columns_of_residuals(column: str) -> None:
    assert f"`{column}`" in text("results.md")


def test_keys_and_columns_of_results(tmp_path: Path) -> None:
    run = mor("adjust", write_block(tmp_path), "--json")
    data = json.loads(run.out)
    page = text("results.md")
    missing = [key for key in data if f"`{key}`" not in page]
    missing += [key for key in data["points"][0] if f"`{key}`" not in page]
    missing += [key for key in data["images"][0] if f"`{key}`" not in page and not key.startswith("s")]
    missing += [key for key in data["sigma0"] if f"`{key}`" not in page]
    assert missing == []


def test_rooms_and_functions_of_the_architecture_exist() -> None:
    page = text("architecture.md")
    tree = [f"/{path.relative_to(ROOT).as_posix()}" for path in (ROOT / "mor").rglob("*")]
    tree += [f"/{name}/{path.name}" for name in ("docs", "tests") for path in (ROOT / name).iterdir()]
    rooms = re.findall(r"`([\w/]+(?:/|\.py|\.js|\.css|\.toml))`", page)
    assert len(rooms) > 40
    assert [room for room in rooms if not any(path.endswith(f"/{room.rstrip('/')}") for path in tree)] == []
    arrows = re.findall(
        r"(?:\| +|`)((?:pipeline|iterate|assessment|solution|results)(?:\.\w+)+)",
        page.split("## The folders")[0],
    )
    functions = [name.rsplit(".", 1) for name in arrows if not name.endswith((".py", ".json"))]
    places = {
        "pipeline": "api",
        "iterate": "solve",
        "assessment": "quality",
        "solution": "quality",
        "results": "report",
    }
    assert len(functions) >= 8
    assert [f for module, f in functions if not hasattr(import_module(f"mor.{places[module]}.{module}"), f)] == []


def test_new_type_of_the_page_is_right(tmp_path: Path) -> None:
    """The example runs, and its derivatives are those of differences."""
    (code,) = re.findall(r"^```python\n(.*?)^```$", text("adding-an-observation-type.md"), re.M | re.S)
    space: dict[str, object] = {}
    exec(code, space)
    equation = space["equation"]
    random = np.random.default_rng(2)
    blocks = [random.normal(size=(5, 3)) * 10.0 for _ in range(3)]
    none = np.zeros((5, 0))
    computed = equation(blocks, none)
    assert computed.values[:, 0] == pytest.approx(
        np.linalg.norm(blocks[2] - blocks[0], axis=1) - np.linalg.norm(blocks[1] - blocks[0], axis=1)
    )
    for slot in range(3):
        for k in range(3):
            step = [b.copy() for b in blocks]
            step[slot][:, k] += 1e-6
            back = [b.copy() for b in blocks]
            back[slot][:, k] -= 1e-6
            difference = (equation(step, none).values - equation(back, none).values) / 2e-6
            assert computed.jacobians[slot][:, :, k] == pytest.approx(difference, abs=1e-8)


@pytest.mark.parametrize("page", PAGES, ids=lambda path: path.relative_to(ROOT).as_posix())
def test_links_lead_to_files_that_exist(page: Path) -> None:
    for target in re.findall(r"\]\(([^)#]+)(?:#[^)]*)?\)", page.read_text(encoding="utf-8")):
        if not target.startswith("http"):
            assert (page.parent / target).exists(), target


@pytest.mark.parametrize("page", PAGES, ids=lambda path: path.relative_to(ROOT).as_posix())
def test_no_paths_of_a_machine(page: Path) -> None:
    assert not re.search(r"/(work|home|root|Users|tmp)/", page.read_text(encoding="utf-8"))
