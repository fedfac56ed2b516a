"""What is seen of the network before the chart library is there."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import pytest

from tests.page_in_browser import wait_until

pytestmark = pytest.mark.browser


def test_until_there_is_a_chart_its_sketch_is_seen(browser: Any, facade_page: Path, tmp_path: Path) -> None:
    text = facade_page.read_text(encoding="utf-8")
    waiting = tmp_path / "waiting.html"
    waiting.write_text(text.replace("const library = loadLibrary();", "const library = new Promise(() => 0);"))
    browser.get(waiting.as_uri())
    wait_until(browser, "document.documentElement.dataset.ready === 'first'")
    coloured = browser.execute_script(
        "return [...document.querySelectorAll('.sketch')].map((canvas) => { const { width, height } = canvas;"
        "const seen = canvas.getContext('2d').getImageData(0, 0, width, height).data;"
        "return seen.filter((v, k) => k % 4 === 3 && v > 0).length; })"
    )
    assert len(coloured) == 2
    assert all(count > 1000 for count in coloured)


def test_the_chart_takes_its_place(browser: Any, facade_page: Path) -> None:
    browser.get(facade_page.as_uri())
    wait_until(browser, "document.documentElement.dataset.ready === 'all'")
    assert not browser.find_elements("css selector", ".sketch")
