"""The how-to pages: short, every command is run, and every output shown is the real one."""

from __future__ import annotations

import re
import shutil
from pathlib import Path
from types import ModuleType
from typing import Any

import pytest

import mor
from tests.docs.test_formats_pages import DOCS as FORMAT_PAGES
from tests.docs.test_formats_pages import _files
from tests.docs.test_tutorials import tutorials
from tools.prose import measure

__all__ = ["tutorials"]
ROOT = Path(__file__).parents[2]
PAGES = sorted((ROOT / "docs" / "how-to").glob("*.md"))
RUN = [path for path in PAGES if path.stem not in ("add-a-format", "batch", "python")]
"""Pages whose commands are run here; test_batch_page and the test below run the code of the others."""


@pytest.mark.slow
@pytest.mark.parametrize("path", RUN, ids=lambda path: path.stem)
def test_page_shows_what_the_program_says(tutorials: ModuleType, path: Path, tmp_path: Path) -> None:
    page = path.read_text(encoding="utf-8")
    assert "```console" in page
    for name in re.findall(r"\(\.\./formats/([\w-]+)\.md\)", page):
        for file, content in _files((FORMAT_PAGES / f"{name}.md").read_text(encoding="utf-8")).items():
            (tmp_path / file).parent.mkdir(exist_ok=True)
            (tmp_path / file).write_text(content, encoding="utf-8")
    assert tutorials.run_page(page, tmp_path).mismatches == []


def test_code_of_the_python_page_runs(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    shutil.copytree(ROOT / "sample_projects" / "facade", tmp_path / "facade")
    monkeypatch.chdir(tmp_path)
    (code,) = re.findall(
        r"^```python\n(.*?)^```", (ROOT / "docs" / "how-to" / "python.md").read_text("utf-8"), re.M | re.S
    )
    names: dict[str, Any] = {}
    exec(code, names)
    assert len(names["weakest"]) == 5
    assert set(names["flagged"]["flag"]) == {"gross"}
    assert (tmp_path / "python.results" / "results.json").is_file()


def test_reader_of_the_format_page_reads(tmp_path: Path) -> None:
    (code,) = re.findall(
        r"^```python\n(.*?)^```",
        (ROOT / "docs" / "how-to" / "add-a-format.md").read_text("utf-8"),
        re.M | re.S,
    )
    names: dict[str, Any] = {}
    exec(code, names)
    (tmp_path / "good.txt").write_text("P1 1 2 3\nP2 4 5 6\n", encoding="utf-8")
    (tmp_path / "bad.txt").write_text("P1 1 2 3\nP2 4 5\n", encoding="utf-8")
    (table,) = names["read_points"](tmp_path / "good.txt").data["points"]
    assert table["rows"] == [["P1", "1", "2", "3"], ["P2", "4", "5", "6"]]
    with pytest.raises(mor.InputError, match=r"bad\.txt:2: found 3 words"):
        names["read_points"](tmp_path / "bad.txt")


@pytest.mark.parametrize("path", [p for p in PAGES if p.stem != "batch"], ids=lambda path: path.stem)
def test_page_is_short(path: Path) -> None:
    assert measure(path.read_text(encoding="utf-8")).words <= 150
