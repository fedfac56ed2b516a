"""What all tests share: the hand-built networks of ``scenes.py``, and the reference data beside the repository."""

from __future__ import annotations

import sys
from collections.abc import Callable, Generator
from pathlib import Path

import pytest

sys.path.insert(0, str(Path(__file__).parent))

from reference_data import MISSING, missing, reference_folder


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
