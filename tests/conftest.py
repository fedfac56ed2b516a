"""What all tests share: the path to their modules, the reference data beside the repository, and the markers."""

from __future__ import annotations

from collections.abc import Callable, Generator
from pathlib import Path

import pytest

from mor.linalg import compilation
from tests.reference_data import MISSING, missing, reference_folder

compilation.elsewhere = True  # tests of single steps compare kernels with the plain form


@pytest.fixture(scope="session")
def shared_data() -> Callable[[str], Path]:
    """Folder of a reference data set by name; the test is skipped where it is missing."""

    def find(name: str) -> Path:
        folder = reference_folder(name)
        if folder is None:
            pytest.skip(missing(name))
        return folder

    return find


@pytest.hookimpl(wrapper=True)
def pytest_runtest_makereport() -> Generator[None, pytest.TestReport, pytest.TestReport]:
    """Give all tests that lack reference data the same place, so that the summary counts them in one line."""
    report = yield
    if report.skipped and isinstance(report.longrepr, tuple) and report.longrepr[2].endswith(MISSING):
        report.longrepr = ("tests", None, MISSING)
        report.keywords = {key: value for key, value in report.keywords.items() if key != "skip"}
    return report


def pytest_configure(config: pytest.Config) -> None:
    """Register the marker that this file sets."""
    config.addinivalue_line(
        "markers", "shared_data: uses the reference data beside the repository, if present"
    )


@pytest.hookimpl(tryfirst=True)
def pytest_collection_modifyitems(items: list[pytest.Item]) -> None:
    """Mark tests that need a browser as slow, and tests of modules that look for reference data as ``shared_data``."""
    finders = {"reference_files", "reference_folder"}
    for item in items:
        if item.get_closest_marker("browser"):
            item.add_marker("slow")
        if "shared_data" in getattr(item, "fixturenames", ()) or finders & vars(item.module).keys():
            item.add_marker("shared_data")
