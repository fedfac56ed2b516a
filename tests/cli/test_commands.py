"""The commands from outside: exit codes, what goes where, help without heavy imports."""

from __future__ import annotations

import errno
import json
import subprocess
import sys
from pathlib import Path

import pytest

from mor.cli import run
from tests.scenarios.small_projects import BLOCK, LEVELLING, block, mor, table, write, write_block

HEAVY = ("numpy", "scipy", "polars", "numba", "pydantic", "yaml", "rich")
MISFIT = LEVELLING.replace("1.001,", "1.021,")
"""Misclosure 22 mm where σ = √3 mm is expected."""
NO_DATUM = BLOCK.replace("datum: free\n", "")


def loaded(code: str) -> set[str]:
    """Heavy modules that are loaded after running a command line in a process of its own."""
    text = f"{code}\nimport sys\nprint('loaded', *[m for m in {HEAVY} if m in sys.modules])"
    done = subprocess.run([sys.executable, "-c", text], capture_output=True, text=True, check=True)
    return set(done.stdout.splitlines()[-1].split()[1:])


class TestHelp:
    @pytest.mark.parametrize("arguments", [["--help"], ["--version"], ["adjust", "--help"], ["check", "-h"]])
    def test_imports_nothing_heavy(self, arguments: list[str]) -> None:
        assert loaded(f"from mor.cli import run; run({arguments})") == set()

    def test_the_test_would_notice(self) -> None:
        assert "pydantic" in loaded("from mor.cli import run; run(['schema'])")

    def test_names_all_commands(self) -> None:
        run = mor("--help")
        assert run.code == 0
        assert all(name in run.out for name in ("adjust", "check", "schema"))

    def test_version(self) -> None:
        from mor import __version__

        assert mor("--version") == (0, f"mor {__version__}\n", "")

    def test_module_can_be_run(self) -> None:
        done = subprocess.run([sys.executable, "-m", "mor", "--version"], capture_output=True, text=True)
        assert (done.returncode, done.stderr) == (0, "")


class TestStartValues:
    def test_their_search_is_loaded_where_some_are_missing(self, tmp_path: Path) -> None:
        unknown = "{columns: [id, x, y], rows: [[B, 0, 0], [C, 0, 0]], fixed: [x, y]}"
        known = "{columns: [id, x, y, z], rows: [[B, 0, 0, 11], [C, 0, 0, 12]], fixed: [x, y]}"
        project = write(tmp_path, LEVELLING.replace(known, unknown))
        adjust = "import sys; from mor.cli import run; run(['adjust', {!r}, '-q', '--no-html'])"
        search = "print('mor.start.assembly' in sys.modules, 'scipy.optimize' in sys.modules)"
        adjusted = tmp_path / "project.results" / "adjusted.yaml"
        said = []
        for path in (project, adjusted):
            code = f"{adjust.format(str(path))}; {search}"
            done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
            said.append(done.stdout.split())
        assert said == [["True", "False"], ["False", "False"]]


class TestExitCodes:
    def test_done(self, tmp_path: Path) -> None:
        run = mor("adjust", write(tmp_path, LEVELLING), "--strict")
        assert run.code == 0

    def test_rejected_only_under_strict(self, tmp_path: Path) -> None:
        project = write(tmp_path, MISFIT)
        assert mor("adjust", project).code == 0
        run = mor("adjust", project, "--force", "--strict")
        assert run.code == 1
        assert "Global test REJECTED" in run.err

    def test_flagged_alone_is_rejected_under_strict(self, tmp_path: Path) -> None:
        rows = block(noise=0.002)
        rows.rays[5][2] += 0.012
        project = write_block(tmp_path, rows=rows)
        run = mor("adjust", project, "--strict")
        assert "Global test accepted" in run.err
        assert run.code == 1

    def test_input(self, tmp_path: Path) -> None:
        assert mor("adjust", tmp_path / "nothing.yaml").code == 2

    @pytest.mark.parametrize("options", [(), ("--all",)])
    def test_a_project_with_mistakes_fails_the_check(self, tmp_path: Path, options: tuple[str, ...]) -> None:
        run = mor("check", write(tmp_path, LEVELLING.replace("1.001", "high")), *options)
        assert run.code == 2
        assert "found 'high', expected a number" in run.err

    @pytest.mark.parametrize("arguments", [["adjst"], ["check"], ["adjust", "--nonsense"], ["check", "a", "b"]])
    def test_wrong_command_line(self, arguments: list[str]) -> None:
        run = mor(*arguments)
        assert (run.code, run.out) == (2, "")
        assert "Usage" in run.err

    def test_not_converged(self, tmp_path: Path) -> None:
        run = mor("adjust", write_block(tmp_path, BLOCK + "settings: {max_iterations: 1}\n"))
        assert run.code == 3
        assert "NO SOLUTION: not converged" in run.err
        assert "max_iterations" in run.err

    def test_singular(self, tmp_path: Path) -> None:
        run = mor("adjust", write_block(tmp_path, NO_DATUM))
        assert run.code == 4
        assert "datum: free" in run.err

    def test_internal(self, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
        def broken(*_: object) -> None:
            raise ZeroDivisionError("by zero")

        monkeypatch.setattr("mor.api.pipeline.solve_network", broken)
        run = mor("adjust", write(tmp_path, LEVELLING))
        assert run.code == 70
        assert run.err.startswith("internal error: ZeroDivisionError: by zero")
        assert "Traceback" not in run.err
        monkeypatch.setenv("MOR_DEBUG", "1")
        assert "Traceback" in mor("adjust", write(tmp_path, LEVELLING)).err

    def test_unreadable_file(self, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
        def denied(*_: object, **__: object) -> bytes:
            raise PermissionError(13, "Permission denied")

        project = write(tmp_path, LEVELLING)
        monkeypatch.setattr(Path, "read_bytes", denied)
        assert mor("check", project) == (2, "", f"{project}: this file cannot be read: Permission denied\n")


class TestWhatGoesWhere:
    def test_words_on_stderr_nothing_on_stdout(self, tmp_path: Path) -> None:
        run = mor("adjust", write(tmp_path, LEVELLING))
        assert run.out == ""
        assert run.err.startswith("Converged after ")
        assert run.err.endswith(f"results in {tmp_path}/project.results\n")

    def test_quiet_says_nothing(self, tmp_path: Path) -> None:
        project = write(tmp_path, LEVELLING)
        assert mor("adjust", project, "-q") == (0, "", "")
        assert mor("check", project, "--quiet") == (0, "", "")

    def test_quiet_still_says_that_there_is_no_solution(self, tmp_path: Path) -> None:
        run = mor("adjust", write_block(tmp_path, NO_DATUM), "-q")
        assert run.code == 4
        assert "NO SOLUTION" in run.err

    def test_iterations_are_plain_lines_where_nobody_looks_and_only_if_asked_for(self, tmp_path: Path) -> None:
        run = mor("adjust", write(tmp_path, LEVELLING), "-v")
        assert "\niteration 1: sigma0 / a priori " in run.err
        assert "\x1b" not in run.err
        assert "iteration 1" not in mor("adjust", write(tmp_path, LEVELLING), "--force").err

    def test_verbose_tells_phases(self, tmp_path: Path) -> None:
        assert mor("adjust", write(tmp_path, LEVELLING), "-v").err.startswith("reading …\nadjusting …\niteration 1:")

    def test_check_counts_on_stdout_and_writes_nothing(self, tmp_path: Path) -> None:
        project = write_block(tmp_path)
        before = sorted(tmp_path.iterdir())
        run = mor("check", project)
        assert (run.code, run.err) == (0, "")
        lines = [line.strip() for line in run.out.splitlines()]
        assert {"4 images", "12 points"} <= set(lines)
        assert any(line.startswith("96 observations, 60 unknowns, datum: free") for line in lines)
        assert sorted(tmp_path.iterdir()) == before

    def test_schema_is_json_schema_of_the_project(self) -> None:
        run = mor("schema")
        schema = json.loads(run.out)
        assert (run.code, run.err) == (0, "")
        assert schema["$schema"].startswith("https://json-schema.org/")
        assert {"cameras", "images", "points", "observations", "datum"} <= set(schema["properties"])
        assert schema["additionalProperties"] is False


class TestJson:
    def test_on_stdout_and_no_files(self, tmp_path: Path) -> None:
        project = write_block(tmp_path)
        before = sorted(tmp_path.iterdir())
        run = mor("adjust", project, "--json", "-q")
        data = json.loads(run.out)
        assert (run.code, run.err) == (0, "")
        assert (data["observations"], data["unknowns"], data["defect"], data["redundancy"]) == (96, 60, 7, 43)
        assert data["outcome"] == "converged"
        assert sorted(tmp_path.iterdir()) == before

    def test_files_too_where_a_folder_is_named(self, tmp_path: Path) -> None:
        run = mor("adjust", write(tmp_path, LEVELLING), "--json", "-o", tmp_path / "out")
        written = json.loads((tmp_path / "out" / "results.json").read_text())
        assert json.loads(run.out)["points"] == written["points"]

    def test_is_there_without_a_solution_too(self, tmp_path: Path) -> None:
        run = mor("adjust", write_block(tmp_path, NO_DATUM), "--json")
        data = json.loads(run.out)
        assert run.code == 4
        assert data["outcome"] == "singular"
        assert data["sigma0"] is None
        assert len(data["movements"]) == 7

    def test_pipe_that_is_closed_while_it_is_written_to_is_no_failure(
        self, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
    ) -> None:
        def closed(*_: object, **__: object) -> None:
            raise BrokenPipeError(errno.EPIPE, "Broken pipe")

        monkeypatch.setattr("mor.cli.adjust.click.echo", closed)
        assert run(["adjust", str(write_block(tmp_path)), "--json", "-q"]) == 0

    def test_closed_pipe_is_no_failure(self, tmp_path: Path) -> None:
        project = write_block(tmp_path)
        line = f'"{sys.executable}" -m mor adjust "{project}" --json -q | head -c 10; exit ${{PIPESTATUS[0]}}'
        done = subprocess.run(["bash", "-c", line], capture_output=True, text=True)
        assert "Traceback" not in done.stderr
        assert done.returncode == 0


def test_same_input_same_bytes(tmp_path: Path) -> None:
    project = write_block(tmp_path)
    for name in ("one", "two"):
        done = subprocess.run(
            [sys.executable, "-m", "mor", "adjust", str(project), "-o", str(tmp_path / name), "-q"],
            capture_output=True,
            check=True,
        )
        assert done.stderr == b""
    files = sorted(path.name for path in (tmp_path / "one").iterdir())
    assert files == sorted(path.name for path in (tmp_path / "two").iterdir())
    for name in files:
        assert (tmp_path / "one" / name).read_bytes() == (tmp_path / "two" / name).read_bytes(), name


def test_results_do_not_depend_on_where_the_command_is_called(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    project = write_block(tmp_path / "here")
    assert mor("adjust", project).code == 0
    first = {p.name: p.read_bytes() for p in (tmp_path / "here" / "project.results").iterdir()}
    monkeypatch.chdir(tmp_path / "here")
    assert mor("adjust", "project.yaml", "--force").code == 0
    assert {p.name: p.read_bytes() for p in Path("project.results").iterdir()} == first
    assert not any(str(tmp_path).encode() in content for content in first.values())


def test_table_is_in_another_folder(tmp_path: Path) -> None:
    """Tables are found from the project file, whatever the working directory."""
    project = write_block(tmp_path, BLOCK.replace("rays.csv", "../data/rays.csv"))
    (tmp_path.parent / "data").mkdir(exist_ok=True)
    (tmp_path / "rays.csv").rename(tmp_path.parent / "data" / "rays.csv")
    assert mor("adjust", project).code == 0


def test_points_table_helper_writes_all_digits() -> None:
    assert table("a,b", [["010", 0.1 + 0.2]]) == "a,b\n010,0.30000000000000004\n"
