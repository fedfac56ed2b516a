"""The site of the documentation is built without a warning, has every page, and fetches nothing."""

from __future__ import annotations

import re
import subprocess
import sys
from pathlib import Path

import pytest

DOCS = Path(__file__).parents[2] / "docs"
PAGES = sorted(path.relative_to(DOCS).with_suffix("") for path in DOCS.rglob("*.md"))
FETCHED = re.compile(r"<(?:script|link|img|source)\b[^>]*?(?:src|href)=\"(?:https?:)?//", re.I)


@pytest.fixture(scope="module")
def site(tmp_path_factory: pytest.TempPathFactory) -> Path:
    for needed in ("sphinx", "myst_parser", "furo"):
        pytest.importorskip(needed, reason="the site needs pip install '.[docs]'")
    folder = tmp_path_factory.mktemp("site")
    command = [sys.executable, "-m", "sphinx", "-q", "-W", "--keep-going", "-b", "html", DOCS, folder]
    done = subprocess.run(command, capture_output=True, text=True)
    assert done.returncode == 0, done.stderr
    return folder


@pytest.mark.slow
def test_every_page_is_there_and_fetches_nothing(site: Path) -> None:
    for page in PAGES:
        html = (site / page.with_suffix(".html")).read_text(encoding="utf-8")
        assert not FETCHED.search(html), page


@pytest.mark.slow
def test_search_finds_without_a_server(site: Path) -> None:
    assert (site / "searchindex.js").read_text(encoding="utf-8").startswith("Search.setIndex(")
    options = (site / "_static" / "documentation_options.js").read_text(encoding="utf-8")
    assert re.search(r"SHOW_SEARCH_SUMMARY:\s*false", options)


@pytest.mark.parametrize("page", PAGES, ids=str)
def test_first_page_leads_to_every_other(page: Path) -> None:
    if page.name != "index":
        index = (DOCS / "index.md").read_text(encoding="utf-8")
        assert f"]({page.as_posix()}.md)" in index
