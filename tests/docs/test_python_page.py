"""The page about Python and the notebook: every piece of code in them runs, in its order, and says what is claimed."""

from __future__ import annotations

import json
import re
import shutil
from pathlib import Path
from typing import Any

import pytest

ROOT = Path(__file__).parents[2]
DOCS = ROOT / "docs"


@pytest.fixture
def beside_facade(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    shutil.copytree(ROOT / "sample_projects" / "facade", tmp_path / "facade")
    monkeypatch.chdir(tmp_path)
    return tmp_path


def last_value(code: str, names: dict[str, Any]) -> Any:
    """Run a cell; the value of its last line where that is an expression."""
    *before, last = code.rstrip().split("\n")
    exec("\n".join(before), names)
    try:
        return eval(last, names)
    except SyntaxError:
        exec(last, names)
        return None


def test_code_of_the_page_runs(beside_facade: Path) -> None:
    names: dict[str, Any] = {}
    for code in re.findall(r"^```python\n(.*?)^```", (DOCS / "python.md").read_text(), re.M | re.S):
        exec(code, names)
    assert names["levels"].points.row("B")["z"] == pytest.approx(11.001, abs=1e-12)
    assert (beside_facade / "results" / "results.json").is_file()


@pytest.mark.slow
def test_cells_of_the_notebook_run(beside_facade: Path) -> None:
    pytest.importorskip("matplotlib")
    notebook = json.loads((DOCS / "tutorials" / "python.ipynb").read_text(encoding="utf-8"))
    names: dict[str, Any] = {}
    values = [
        last_value("".join(cell["source"]), names)
        for cell in notebook["cells"]
        if cell["cell_type"] == "code" and not cell["outputs"]
    ]
    assert [value for value in values if isinstance(value, bool)] == [True, True, False]
    assert names["flagged"].height == 3
    assert 1.7 < names["sharper"].sigma0 / names["result"].sigma0 <= 2.0
    assert (beside_facade / "facade.results" / "report.html").is_file()
