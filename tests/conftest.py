"""What all tests share: the path to their modules, the reference data beside the repository, and the markers."""

from __future__ import annotations

from collections.abc import Callable, Generator
from pathlib import Path

import pytest

from mor.linalg import compilation
from tests.reference_data import MISSING, missing, reference_folder


def pytest_addoption(parser: pytest.Parser) -> None:
    """Let the tests of single steps use kernels, and with them the tests that compare kernels with plain NumPy."""
    parser.addoption("--kernels", action="store_true", help="single steps use compiled kernels")


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
    """Register the markers, and let kernels be used if they are asked for."""
    compilation.elsewhere = config.getoption("kernels")
    config.addinivalue_line("markers", "shared_data: uses the reference data beside the repository, if present")
    config.addinivalue_line("markers", "kernels: needs compiled kernels (pytest --kernels)")


@pytest.hookimpl(tryfirst=True)
def pytest_collection_modifyitems(config: pytest.Config, items: list[pytest.Item]) -> None:
    """Mark tests by what they need, and leave those of kernels out where kernels are not used."""
    if not compilation.wanted():
        of_kernels = [item for item in items if item.get_closest_marker("kernels")]
        config.hook.pytest_deselected(items=of_kernels)
        items[:] = [item for item in items if not item.get_closest_marker("kernels")]
    finders = {"reference_files", "reference_folder"}
    for item in items:
        if item.get_closest_marker("browser"):
            item.add_marker("slow")
        if "shared_data" in getattr(item, "fixturenames", ()) or finders & vars(item.module).keys():
            item.add_marker("shared_data")
