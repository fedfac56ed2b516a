"""The pages of the formats: their examples run, every format is on them, and every untried one says so."""

from __future__ import annotations

import re
from pathlib import Path

import pytest

from mor.formats import FORMATS
from tests.scenarios.small_projects import mor

DOCS = Path(__file__).parents[2] / "docs" / "formats"
PAGES = sorted(path for path in DOCS.glob("*.md") if path.name != "index.md")


def _files(text: str) -> dict[str, str]:
    """Files of a page by name: the indented lines behind a line that says ``File `name`:``."""
    found = re.findall(r"^File `([^`]+)`:\n\n((?:(?: {4}.*)?\n)+)", text, re.M)
    return {name: re.sub(r"^ {4}", "", body.split("\n    $ ")[0], flags=re.M).rstrip("\n") for name, body in found}


@pytest.mark.parametrize("page", PAGES, ids=lambda path: path.stem)
def test_the_example_runs(page: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    text = page.read_text(encoding="utf-8")
    files = _files(text)
    assert files
    for name, content in files.items():
        (tmp_path / name).parent.mkdir(exist_ok=True)
        (tmp_path / name).write_text(content, encoding="utf-8")
    monkeypatch.chdir(tmp_path)
    commands = re.findall(r"^    \$ mor (.*)$", text, re.M)
    assert commands
    for command in commands:
        run = mor(*command.split())
        assert run.code == 0, run.err
        target = command.split(" --")[0].split()[-1]
        assert Path(target).exists()
        if command.endswith(".yaml"):
            assert mor("check", target).code == 0


def test_every_format_is_in_the_list() -> None:
    listed = (DOCS / "index.md").read_text(encoding="utf-8")
    assert [key for key in FORMATS if f"`{key}`" not in listed] == []
