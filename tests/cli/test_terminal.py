"""What a person sees who runs ``mor adjust`` at a terminal."""

from __future__ import annotations

import io
import os
import re
import subprocess
import sys
from pathlib import Path

import pytest
from rich.console import Console

from mor.api.pipeline import read_document, read_network, solve_network
from mor.cli.adjust import left_out
from mor.cli.progress import MOST, Progress, iteration_line, iteration_table
from mor.linalg import compilation
from mor.quality.redundancy import Done
from mor.quality.solution import Solved
from mor.report.language import words_of
from mor.report.text import WIDTH, screen
from mor.solve.iterate import Iteration
from tests.scenarios.small_projects import LEVELLING, block, mor, write, write_block

SAMPLES = Path(__file__).parents[2] / "sample_projects"
LINES = 24
CONTROLS = re.compile(r"\x1b\[[0-9;?]*[A-Za-z]")


def solved(name: str) -> Solved:
    folder = SAMPLES / name
    return solve_network(read_network(read_document(folder / "project.yaml"), folder))


@pytest.fixture(scope="module", params=["building", "machine_part", "facade"])
def outcome(request: pytest.FixtureRequest) -> Solved:
    return solved(request.param)


def rows(steps: list[Iteration], most: int | None = MOST) -> list[list[str]]:
    console = Console(file=io.StringIO(), width=100, force_terminal=False)
    console.print(iteration_table(steps, "adjusted", most))
    text = console.file.getvalue()  # type: ignore[attr-defined]
    return [
        line.split()
        for line in text.splitlines()
        if line.split() and line.split()[0] in ("…", *"123456789", "10", "11", "12")
    ]


def step(number: int, damping: float = 0.0) -> Iteration:
    return Iteration(number, 400.0, 0.25, damping, 100)


def test_iterations_show_sigma0_change_and_step() -> None:
    assert rows([step(1), step(2, 1e-3)]) == [
        ["1", "2", "0.25", "full", "step"],
        ["2", "2", "0.25", "damping", "1e-03"],
    ]
    assert iteration_line(step(1)) == "iteration 1: sigma0 / a priori 2, largest change 0.25 sigma, full step"


def test_what_is_told_on_the_way_is_german(tmp_path: Path) -> None:
    told = mor("adjust", write(tmp_path, LEVELLING), "--verbose", "--lang", "de", "--no-html").err
    for line in ("liest …", "gleicht aus …", "Genauigkeit und Zuverlässigkeit …", "schreibt …"):
        assert line in told.splitlines()
    assert re.search(r"^Iteration 1: .*, größte Änderung \S+ sigma, voller Schritt$", told, re.MULTILINE)
    assert re.search(r"^Dauer der Phasen: liest \d+[.]\d s, gleicht aus .* s, schreibt \d+[.]\d s$", told, re.MULTILINE)
    assert iteration_line(step(1), words_of("de")).startswith("Iteration 1: sigma0 / a priori 2, ")
    assert "Dämpfung 1e-03" in iteration_line(step(1, 1e-3), words_of("de"))


def test_notes_are_there_in_german(outcome: Solved, monkeypatch: pytest.MonkeyPatch) -> None:
    german = words_of("de").catalogue
    monkeypatch.setattr("mor.report.results.MOST_LISTED", 1)
    monkeypatch.setattr("mor.report.results.MOST_OF_PAGE", 1)
    notes = [note.message for note in left_out(outcome, None, None)]
    assert len(notes) == 2
    assert {*notes, compilation.COMPILING, compilation.MISSING, compilation.FAILED} <= set(german)


def test_of_many_iterations_the_first_and_the_last_are_shown() -> None:
    many = [step(number) for number in range(1, 13)]
    assert [row[0] for row in rows(many)] == ["1", "…", *map(str, range(7, 13))]
    assert len(rows(many)) == MOST
    assert [row[0] for row in rows(many, None)] == [str(number) for number in range(1, 13)]
    assert [row[0] for row in rows(many[:MOST])] == [str(number) for number in range(1, MOST + 1)]


def test_nothing_redundant_has_no_sigma0() -> None:
    free = Iteration(1, 0.0, 0.25, 0.0, 0)
    assert rows([free])[0][1] == "–"
    assert "vTPv 0" in iteration_line(free)


def test_last_sigma0_is_that_of_the_result(outcome: Solved) -> None:
    assert outcome.quality is not None
    last = outcome.adjustment.iterations[-1].sigma0
    assert last == pytest.approx(outcome.quality.sigma0, rel=1e-9)


@pytest.mark.parametrize("language", ["en", "de"])
def test_summary_fits_one_screen(outcome: Solved, language: str) -> None:
    lines = screen(outcome, words_of(language)).splitlines()
    assert len(lines) <= LINES
    assert max(map(len, lines)) <= WIDTH
    assert not any(line.endswith("…") for line in lines)


def test_summary_answers_what_is_asked_first() -> None:
    facade = solved("facade")
    text = screen(facade)
    assert "Global test accepted at the level 0.05." in text
    assert "Worst: image IMG_4711, point W50, x: |w| = 3.46, r = 0.71 (flagged)" in text
    assert "weakest K03: longest semi-axis 0.0046 m" in text
    assert "Camera D7: c = 28.37459 ± 0.0038 mm" in text
    assert "Datum: fixed" in text
    assert "image_points.csv" not in text
    groups = screen(facade, verbose=True)
    assert re.search(r"^image_points.csv +2062 +1606.1 +0.989 +3.46 +3$", groups, re.MULTILINE)


def test_at_most_twenty_lines_however_much_there_is_to_say(tmp_path: Path) -> None:
    """Forty heights, each observed twice alike and once half a metre off."""
    names = [f"P{k}" for k in range(1, 41)]
    points = ", ".join(f"[{name}, 0, 0, 11]" for name in names)
    rows = ", ".join(f"[A, {name}, {dz}, 0.001]" for name in names for dz in (1.0, 1.0, 1.5))
    text = LEVELLING[: LEVELLING.index("    rows: [[A, B")].replace("[B, 0, 0, 11], [C, 0, 0, 12]", points)
    project = write(tmp_path, f"{text}    rows: [{rows}]\n")
    run = mor("adjust", project, "--no-html")
    assert run.code == 0, run.err
    assert len(run.err.splitlines()) <= 20
    told = mor("adjust", project, "--no-html", "--verbose", "--force")
    assert len(told.err.splitlines()) > 20


def test_long_lines_are_cut(tmp_path: Path) -> None:
    name = "B" * 150
    run = mor("adjust", write(tmp_path, LEVELLING.replace("[B,", f"[{name},").replace(" B,", f" {name},")))
    assert max(len(line) for line in run.err.splitlines()[:-1]) == WIDTH


@pytest.mark.skipif(sys.platform == "win32", reason="needs a pseudo-terminal")
def test_a_terminal_gets_a_live_table_and_keeps_it_where_asked(tmp_path: Path) -> None:
    project = str(write(tmp_path, LEVELLING))
    text = at_a_terminal(["adjust", project, "--no-html"])
    assert text.rstrip().split("\r")[-1].count("\n") <= 20
    text = at_a_terminal(["adjust", project, "--no-html", "--verbose", "--force"])
    assert "iteration   σ0 / a priori   largest change [σ]        step" in text
    assert "adjusted" in text
    assert "iteration 1:" not in text
    assert "Converged after " in text


@pytest.mark.skipif(sys.platform == "win32", reason="needs a pseudo-terminal")
def test_quiet_says_nothing_at_a_terminal_either(tmp_path: Path) -> None:
    assert at_a_terminal(["adjust", str(write(tmp_path, LEVELLING)), "--quiet"]) == ""


def at_a_terminal(arguments: list[str]) -> str:
    """What a command line writes to a terminal of 100 columns, without control sequences."""
    import pty

    ours, theirs = pty.openpty()
    environment = {**os.environ, "TERM": "xterm-256color", "COLUMNS": "100", "LINES": "30"}
    command = [sys.executable, "-m", "mor", *arguments]
    with subprocess.Popen(command, stdin=theirs, stdout=theirs, stderr=theirs, env=environment):
        os.close(theirs)
        said = bytearray()
        while True:
            try:
                part = os.read(ours, 65536)
            except OSError:  # the other end is closed
                break
            if not part:
                break
            said += part
    os.close(ours)
    return CONTROLS.sub("", said.decode("utf-8"))


class Line:
    """Stands for the live line of a terminal."""

    def __init__(self) -> None:
        self.said: list[str] = []

    def update(self, words: object) -> None:
        self.said.append(str(words))


def test_a_phase_tells_how_much_is_left(monkeypatch: pytest.MonkeyPatch) -> None:
    now = [100.0]
    monkeypatch.setattr("mor.cli.progress.time.monotonic", lambda: now[0])
    line = Line()
    more = Progress(False, False, line).phase("precision and reliability", 400)  # type: ignore[arg-type]
    for count in (1, 1, 2, 196, 1, 199):
        now[0] += 0.1 * count
        more(count)
    name = "precision and reliability"
    assert line.said == [
        f"{name} …",
        f"{name}: 1 %, 40 s left  {'╌' * 20}",
        f"{name}: 50 %, 20 s left  {'━' * 10}{'╌' * 10}",
        f"{name}: 100 %, 0 s left  {'━' * 20}",
    ]


def test_statistics_tell_all_their_work(tmp_path: Path) -> None:
    project = write_block(tmp_path, rows=block(noise=0.002))
    network = read_network(read_document(project), tmp_path)
    ahead: list[int] = []
    told: list[int] = []

    def assessing(effort: int) -> Done:
        ahead.append(effort)
        return told.append

    solution = solve_network(network, None, assessing)
    assert len(ahead) == 1
    assert sum(told) == ahead[0] >= len(solution.adjustment.plan.rays.row) > 0
