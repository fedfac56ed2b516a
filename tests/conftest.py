"""What all tests share: the path to their modules, the reference data beside the repository, and the markers."""

from __future__ import annotations

from collections.abc import Callable, Generator
from pathlib import Path

import pytest

from mor import compilation
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


KNOWN_FAULTS = (
    "tests/diagnose/test_score_tests.py::test_a_mistake_of_a_whole_is_diagnosed_with_nothing_left[instrument_height_in",
    "tests/domains/test_results.py::test_gross_errors_reject_the_same_groups_and_move_the_same_points",
    "tests/domains/test_snooping.py::test_the_same_rows_go_in_the_same_rounds[an image]",
    "tests/domains/test_weights.py::test_robust_solutions_that_do_not_settle",
)
"""Tests that the present state does not pass, to be mended."""


@pytest.hookimpl(trylast=True)
def pytest_itemcollected(item: pytest.Item) -> None:
    """Expect known faults to fail."""
    if item.nodeid.startswith(KNOWN_FAULTS):
        item.add_marker(pytest.mark.xfail(reason="known fault", strict=False))
