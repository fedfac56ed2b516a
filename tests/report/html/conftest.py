"""A headless browser and pages of small projects; tests that need a browser are skipped where there is none."""

from __future__ import annotations

import os
import shutil
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import pytest

from mor.api.pipeline import read_document, read_network, solve_network
from mor.report.observations import observation_table
from mor.report.page import page
from mor.report.view import View, view_of
from tests.page_in_browser import wait_until

SAMPLES = Path(__file__).parents[3] / "sample_projects"
BROWSERS = ("chromium", "chromium-browser", "google-chrome", "chrome")


def make_view(name: str) -> View:
    """View of a sample project."""
    document = read_document(SAMPLES / name / "project.yaml")
    solved = solve_network(read_network(document, SAMPLES / name))
    return view_of(solved, observation_table(solved))


@pytest.fixture(scope="session")
def facade_view() -> View:
    return make_view("facade")


@pytest.fixture(scope="session")
def building_view() -> View:
    return make_view("building")


@pytest.fixture(scope="session")
def stereo_view() -> View:
    return make_view("stereo_rig")


@pytest.fixture(scope="session")
def browser() -> Iterator[Any]:
    webdriver = pytest.importorskip("selenium.webdriver", reason="selenium is not installed")
    binary = next(filter(None, map(shutil.which, BROWSERS)), None)
    driver = shutil.which("chromedriver")
    if binary is None or driver is None:
        pytest.skip("no headless browser: chromium and chromedriver were not found")
    options = webdriver.ChromeOptions()
    options.binary_location = binary
    flags = ("--headless=new", "--disable-dev-shm-usage", "--window-size=1280,1000", "--use-gl=angle")
    flags += ("--use-angle=swiftshader", "--enable-unsafe-swiftshader")
    for flag in (*flags, *(["--no-sandbox"] if os.geteuid() == 0 else [])):
        options.add_argument(flag)
    options.set_capability("goog:loggingPrefs", {"browser": "ALL", "performance": "ALL"})
    started = webdriver.Chrome(options=options, service=webdriver.ChromeService(driver))
    yield started
    started.quit()


@pytest.fixture(scope="session")
def facade_page(facade_view: View, tmp_path_factory: pytest.TempPathFactory) -> Path:
    path = tmp_path_factory.mktemp("page") / "report.html"
    path.write_text(page(facade_view), encoding="utf-8")
    return path


@pytest.fixture(scope="module")
def opened(browser: Any, facade_page: Path) -> Any:
    """The browser with the page of the facade, everything drawn. Other modules open other pages in it."""
    browser.get_log("browser")
    browser.get(facade_page.as_uri())
    wait_until(browser, "document.documentElement.dataset.ready === 'all'")
    return browser
