"""No option writes over an input of its command, nor over the file of somebody else.

More trials: ``python -m tests.scenarios.output_trials``.

The outputs of all commands are found by the types of their options and arguments: one that is added is tried here.
"""

from __future__ import annotations

import io
import json
import os
import random
import signal
import subprocess
import sys
import time
from pathlib import Path

import click
import pytest

from mor.cli.options import InputPath, OutputPath
from tests.scenarios.output_trials import (
    HOPELESS,
    RECIPES,
    WAYS,
    Output,
    Scene,
    against_file,
    against_input,
    drawn,
    faults_of,
    hopeless,
    outputs,
    parameters,
    within,
)
from tests.scenarios.small_projects import LEVELLING, Run, mor, write


@pytest.fixture(scope="module")
def scene(tmp_path_factory: pytest.TempPathFactory) -> Scene:
    return Scene(tmp_path_factory.mktemp("outputs"))


def test_every_path_of_every_command_is_said_to_be_read_or_written() -> None:
    for command, parameter in parameters():
        where = f"{command} {parameter.opts[0]}"
        assert not isinstance(parameter.type, click.File), where
        if isinstance(parameter.type, click.Path) or getattr(parameter, "metavar", "") in ("FILE", "FOLDER"):
            assert isinstance(parameter.type, InputPath | OutputPath), where


def test_every_command_with_an_output_is_tried() -> None:
    assert {one.command for one in outputs()} == set(RECIPES)


@pytest.mark.parametrize("output", outputs(), ids=str)
def test_nothing_is_written_over_an_input_nor_over_a_file_of_somebody_else(scene: Scene, output: Output) -> None:
    """Under its own name, by a link and by a hard link, with and without ``--force``."""
    for recipe in RECIPES[output.command]:
        draw = random.Random(str(output))
        for way in ("itself", "symbolic link", "hard link"):
            for force in (False, True):
                if recipe.inputs:
                    name = draw.choice(recipe.inputs)
                    trial = against_input(scene, output, recipe, name, way, force)
                    assert faults_of(scene, trial) == [], trial
        trial = against_file(scene, output, recipe)
        assert faults_of(scene, trial) == [], trial


@pytest.mark.slow
@pytest.mark.parametrize("output", outputs(), ids=str)
def test_every_input_in_every_way_and_every_place_where_nothing_can_be_written(scene: Scene, output: Output) -> None:
    for recipe in RECIPES[output.command]:
        for force in (False, True):
            for name in recipe.inputs:
                for way in WAYS:
                    trial = against_input(scene, output, recipe, name, way, force)
                    assert faults_of(scene, trial) == [], trial
            for where in HOPELESS:
                if found := hopeless(scene, output, recipe, where, force):
                    assert faults_of(scene, found) == [], found


def test_drawn_trials(scene: Scene) -> None:
    draw = random.Random(11)
    for _ in range(10):
        trial = drawn(scene, draw)
        assert faults_of(scene, trial) == [], trial


class TestEvents:
    def test_an_existing_file_is_replaced_with_force_and_only_then(self, tmp_path: Path) -> None:
        project, events = write(tmp_path, LEVELLING), tmp_path / "events.jsonl"
        for options, code in (([], 0), ([], 2), (["--force"], 0)):
            assert mor("adjust", project, "--events", events, "--no-html", *options).code == code
            assert events.read_text().splitlines()[-1].startswith('{"event": "done"')
            events.write_text("old\n" + events.read_text()) if code else None

    def test_a_table_of_the_project_is_no_file_of_events(self, tmp_path: Path) -> None:
        """Nobody names it on the command line: it is known when the project has been read."""
        text = LEVELLING.replace("columns: [id, x, y, z], rows: [[A, 0, 0, 10]]", "file: points.csv")
        project = write(tmp_path, text, points="id,x,y,z\nA,0,0,10\n")
        before = (tmp_path / "points.csv").read_bytes()
        run = mor("adjust", project, "--events", tmp_path / "points.csv", "--force")
        assert run.code == 2
        assert "points.csv: this file is an input of the same command" in run.err
        assert (tmp_path / "points.csv").read_bytes() == before

    def test_a_pipe_gets_every_line(self, tmp_path: Path) -> None:
        project, pipe = write(tmp_path, LEVELLING), tmp_path / "pipe"
        os.mkfifo(pipe)
        reader = os.open(pipe, os.O_RDONLY | os.O_NONBLOCK)
        assert mor("adjust", project, "--events", pipe, "--no-html").code == 0
        assert os.read(reader, 100_000).splitlines()[-1].startswith(b'{"event": "done"')
        os.close(reader)


class TestInputsThatCannotBeRead:
    @pytest.mark.parametrize("command", ["adjust", "check", "approximate", "design", "simulate"])
    @pytest.mark.parametrize("what", ["loop", "pipe", "folder", "too long", "below a file", "device"])
    def test_the_path_is_named(self, tmp_path: Path, command: str, what: str) -> None:
        for place in ("project", "table"):
            text = LEVELLING.replace("columns: [id, x, y, z], rows: [[A, 0, 0, 10]]", "file: there.csv")
            project = write(tmp_path / place, text)
            file = project.with_name("there.csv" if place == "table" else "there.yaml")
            name = _made(file, what)
            if place == "table":
                project.write_text(text.replace("there.csv", name))
            run = mor(command, project if place == "table" else project.parent / name)
            assert run.code == 2, run.err
            assert name.split("/")[0][:40] in run.err
            assert "Traceback" not in run.err
            assert "internal" not in run.err

    def test_loops_in_and_around_a_folder(self, tmp_path: Path) -> None:
        project = write(tmp_path / "project", LEVELLING)
        (tmp_path / "project" / "round").symlink_to("round")
        (tmp_path / "loop").symlink_to("loop")
        for arguments, named in (
            (["adjust", tmp_path / "loop"], "loop"),
            (["adjust", project, "-o", tmp_path / "loop"], "loop"),
            (["adjust", project, "-o", tmp_path / "loop" / "out"], "loop"),
            (["convert", tmp_path / "loop", tmp_path / "x.yaml"], "loop"),
            (["report", tmp_path / "loop"], "loop"),
            (["plot", "network", tmp_path / "loop", "-o", tmp_path / "x.svg"], "loop"),
        ):
            run = mor(*arguments)
            assert run.code == 2, (arguments, run.err)
            assert named in run.err
        assert mor("adjust", tmp_path / "project", "--no-html").code == 0
        assert (tmp_path / "project" / "round").is_symlink()


def _made(file: Path, what: str) -> str:
    """Put something that is no file in its place; the name it is reached by."""
    if what == "loop":
        file.symlink_to(file.name)
    elif what == "pipe":
        os.mkfifo(file)
    elif what == "folder":
        file.mkdir()
    elif what == "too long":
        return f"{'n' * 300}{file.suffix}"
    elif what == "below a file":
        file.write_text("mor: 1\n")
        return f"{file.name}/there{file.suffix}"
    else:
        file.symlink_to("/dev/zero")
    return file.name


class TestStandardInput:
    """``-`` reads the project from standard input; tables and results count from the current folder."""

    @staticmethod
    def run(monkeypatch: pytest.MonkeyPatch, text: str, *arguments: object) -> Run:
        monkeypatch.setattr(sys, "stdin", io.TextIOWrapper(io.BytesIO(text.encode())))
        return mor(*arguments)

    @pytest.mark.parametrize("foreign", [False, True])
    def test_is_adjusted_as_the_file_is(self, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, foreign: bool) -> None:
        text = LEVELLING.replace(
            "columns: [from, to, dz, sigma]\n    rows: [[A, B, 1.001, 0.001], [B, C, 1.002, 0.001], "
            "[C, A, -2.001, 0.001]]",
            "file: dz.csv",
        )
        rows = "from,to,dz,sigma\nA,B,1.001,0.001\nB,C,1.002,0.001\nC,A,-2.001,0.001\n"
        project = write(tmp_path, text, dz=rows)
        if foreign:
            project = tmp_path / "net.gkf"
            assert mor("convert", tmp_path / "project.yaml", project).code == 0
        with within(tmp_path):
            assert mor("adjust", project.name, "--no-html").code == 0
            assert mor("check", "-").code == 2  # standard input of the tests is closed or empty
            for _ in range(2):  # the same input again replaces its results
                run = self.run(monkeypatch, project.read_text(), "adjust", "-", "--no-html")
                assert run.code == 0, run.err
            assert self.run(monkeypatch, project.read_text() + "\n", "adjust", "-").code == 2
            assert self.run(monkeypatch, project.read_text(), "check", "-").code == 0
        results = [
            json.loads((tmp_path / name / "results.json").read_text())
            for name in (f"{project.stem}.results", "stdin.results")
        ]
        assert results[0]["points"] == results[1]["points"]
        assert results[1]["identity"]["inputs"][0]["file"] == "stdin"

    def test_mistakes_have_their_line(self, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
        with within(tmp_path):
            run = self.run(monkeypatch, LEVELLING.replace("height_difference", "hight"), "check", "-")
            assert run.code == 2
            assert run.err.startswith("stdin:7: ")
            assert "this file is empty" in self.run(monkeypatch, "", "adjust", "-").err
            (tmp_path / "stdin").write_text(LEVELLING)
            assert mor("check", "stdin").code == 0, "a file of that name is read as a file"

    def test_more_than_the_limit_is_refused(self, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
        monkeypatch.setenv("MOR_MAX_PROJECT_MB", "1")
        run = self.run(monkeypatch, "#" * 1_000_001, "check", "-")
        assert (run.code, run.err[:31]) == (2, "stdin: found more than 1 MB; a ")


class TestTheOnlyProjectOfAFolder:
    def test_is_taken(self, tmp_path: Path) -> None:
        write(tmp_path, LEVELLING)
        (tmp_path / "other.yaml").write_text("steps: [1, 2]\n")
        assert mor("check", tmp_path).code == 0
        with within(tmp_path):
            assert mor("adjust", "--no-html").code == 0
        assert (tmp_path / "project.results" / "results.json").is_file()

    def test_several_are_listed(self, tmp_path: Path) -> None:
        project = write(tmp_path, LEVELLING)
        project.with_name("a.yml").write_text(LEVELLING)
        run = mor("adjust", tmp_path)
        assert run.code == 2
        assert run.err == f"{tmp_path}: this folder has several projects: a.yml, project.yaml; name one of them\n"

    def test_none_is_said(self, tmp_path: Path) -> None:
        with within(tmp_path):
            run = mor("adjust", ".")
        assert run.code == 2
        assert run.err.startswith(".: this is a folder without a project file")
        assert "/project" not in run.err


@pytest.mark.slow
@pytest.mark.parametrize("name", ["SIGINT", "SIGTERM"])
def test_a_signal_while_kernels_are_compiled_ends_the_run(tmp_path: Path, name: str) -> None:
    """LLVM calls Python, and what is raised there is lost: the run went on to its end."""
    pytest.importorskip("numba")
    sample = Path(__file__).parents[2] / "sample_projects" / "building"
    script = (
        "import mor.linalg.compilation as c, sys\n"
        "c.WORTH_COMPILING = 0\n"
        "from mor.__main__ import main\n"
        f"sys.argv = ['mor', 'adjust', {str(sample / 'project.yaml')!r}, '-o', {str(tmp_path / 'out')!r}, '-v']\n"
        "main()\n"
    )
    draw = random.Random(name)
    for trial in range(3):
        cache = tmp_path / f"cache {trial}"
        environment = {
            **os.environ,
            "NUMBA_CACHE_DIR": str(cache),
            "MOR_KERNELS": "numba",
            "PYTHONPATH": str(Path(__file__).parents[2]),
        }
        process = subprocess.Popen([sys.executable, "-c", script], env=environment, stderr=subprocess.PIPE, text=True)
        assert process.stderr is not None
        while "compiling" not in (line := process.stderr.readline()):
            assert line, "no kernel was compiled"
        time.sleep(draw.uniform(0.0, 10.0))
        process.send_signal(getattr(signal, name))
        said = process.communicate(timeout=60)[1]
        assert process.returncode == 128 + getattr(signal, name), said
        assert said.splitlines()[-1] == "interrupted; no file was left incomplete"
        assert "Traceback" not in said
        assert not list(cache.rglob("kernels-*"))
        assert not (tmp_path / "out").exists()
