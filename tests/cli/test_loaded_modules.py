"""What small and large jobs load: a module that is not needed costs every run its time, and is told here by name."""

from __future__ import annotations

import subprocess
import sys
from pathlib import Path

import pytest

from mor.linalg import compilation
from tests.scenarios.small_projects import LEVELLING, mor, write

SAMPLES = Path(__file__).parents[2] / "sample_projects"
NEVER = {
    "numba",
    "llvmlite",
    "plotly",
    "matplotlib",
    "scipy.stats",
    "scipy.optimize",
    "scipy.interpolate",
    "rich",
}
"""What no small project needs, with or without page."""
WITHOUT_PAGE = {"jinja2", "scipy.spatial"}
ONE_FRONT = {"scipy.sparse", "mor.start.assembly", "mor.formats.gkf"}
"""What a network that is one dense front and has its start values does not need either."""


def loaded(*arguments: object, before: str = "") -> set[str]:
    """Modules that are loaded after a command in a process of its own."""
    text = f"{before}\nimport sys\nfrom mor.cli import run\ncode = run({list(map(str, arguments))!r})\n"
    text += "print('loaded', *sys.modules)\nsys.exit(code)"
    done = subprocess.run([sys.executable, "-c", text], capture_output=True, text=True, check=True)
    return set(done.stdout.splitlines()[-1].split()[1:])


def test_the_smallest_network_loads_what_it_needs(tmp_path):
    project = write(tmp_path, LEVELLING)
    modules = loaded("adjust", project, "-q", "--no-html")
    assert "mor.solve.iterate" in modules
    assert modules & (NEVER | WITHOUT_PAGE | ONE_FRONT) == set()


@pytest.mark.parametrize("sample", ["bridge", pytest.param("facade", marks=pytest.mark.slow)])
def test_small_projects_with_their_page_load_no_compiler(sample, tmp_path):
    modules = loaded("adjust", SAMPLES / sample / "project.yaml", "-q", "-o", tmp_path / "results")
    assert "jinja2" in modules
    assert modules & NEVER == set()


@pytest.fixture(scope="module")
def facade(tmp_path_factory):
    """Results of a small project."""
    results = tmp_path_factory.mktemp("facade") / "results"
    assert mor("adjust", SAMPLES / "facade" / "project.yaml", "-q", "--no-html", "-o", results).code == 0
    return results


@pytest.mark.parametrize("command", [["covariance", "--blocks", "-o", "c.csv"], ["datum", "--to", "free", "-o", "d"]])
def test_what_is_done_with_results_of_a_small_project_loads_no_compiler(command, facade, tmp_path):
    name, *rest = command
    modules = loaded(name, facade, *rest[:-1], tmp_path / rest[-1])
    assert modules & NEVER == set()


@pytest.mark.skipif(not compilation.available, reason="there is no compiler")
def test_a_project_that_is_worth_it_takes_the_compiler(tmp_path):
    few = "import mor.linalg.compilation\nmor.linalg.compilation.WORTH_COMPILING = 3\n"
    few += "mor.linalg.compilation._is_sealed = lambda: True  # which its folder is asked for, and so numba"
    project = write(tmp_path, LEVELLING)
    assert "numba" in loaded("adjust", project, "-q", "--no-html", before=few)


def test_import_mor_loads_nothing():
    text = "import sys, mor\nprint(*sys.modules)"
    done = subprocess.run([sys.executable, "-c", text], capture_output=True, text=True, check=True)
    assert set(done.stdout.split()) & {"numpy", "scipy", "polars", "pydantic", "yaml", "click"} == set()


def test_a_batch_begins_without_loading_what_its_processes_do():
    text = "import sys, mor.api.batch, mor.report.batch, mor.report.output_folder\n"
    done = subprocess.run(
        [sys.executable, "-c", text + "print(*sys.modules)"], capture_output=True, text=True, check=True
    )
    assert set(done.stdout.split()) & {"polars", "scipy", "pydantic", "mor.adjustment"} == set()
