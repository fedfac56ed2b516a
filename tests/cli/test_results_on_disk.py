"""Results on disk: nothing overwritten unasked, nothing left half, inputs never touched."""

from __future__ import annotations

import json
import os
import shutil
import signal
import sys
import warnings
from collections.abc import Callable, Mapping
from concurrent.futures import ThreadPoolExecutor
from functools import partial
from pathlib import Path
from types import FrameType

import pytest

from mor.errors import InputError
from mor.output_files import Writer
from mor.report import output_folder as folder_module
from mor.report import output_folder as reservation
from mor.report.output_folder import reserve
from tests.scenarios.small_projects import BLOCK, LEVELLING, mor, write, write_block
from tests.selection import slow_after


def content(folder: Path) -> dict[str, bytes]:
    """The files of a folder without the list of them, which the tests of manifests look at."""
    return {p.name: p.read_bytes() for p in folder.iterdir() if p.is_file() and p.name != "files.json"}


def say(words: str):
    return lambda path: path.write_text(words) and None


def fail(error: BaseException):
    def write_some(path: Path) -> None:
        path.write_text("half of it")
        raise error

    return write_some


class TestOverwriting:
    def test_not_without_force(self, tmp_path: Path) -> None:
        project = write(tmp_path, LEVELLING)
        assert mor("adjust", project).code == 0
        folder = tmp_path / "project.results"
        before = content(folder)
        project.write_text(LEVELLING.replace("1.001,", "1.0015,"))
        run = mor("adjust", project)
        assert run.code == 2
        assert run.err == f"{folder}: the folder exists and is not empty; --force replaces results in it\n"
        assert content(folder) == before
        assert mor("adjust", project, "--force").code == 0
        assert content(folder) != before

    def test_the_same_command_on_the_same_input_may(self, tmp_path: Path) -> None:
        project = write(tmp_path, LEVELLING)
        before = project.stat()
        assert mor("adjust", project, "--lang", "de").code == 0
        folder = tmp_path / "project.results"
        (folder / "notes.txt").write_text("mine")
        assert "Inhalt dieses Ordners" in (folder / "README.txt").read_text(encoding="utf-8")
        assert mor("adjust", project).code == 0
        assert mor("adjust", project, "-o", folder).code == 0
        written = content(folder)
        assert written["README.txt"].startswith(b"Contents of this folder")
        assert all(name.encode() in written["README.txt"] for name in set(written) - {"README.txt", "notes.txt"})
        assert mor("adjust", project).code == 0
        assert content(folder) == written
        for options in (["--snoop"], ["--strict", "--snoop"]):
            assert mor("adjust", project, *options).code == 2
        other = write(tmp_path / "other", LEVELLING + "title: another one\n")
        assert mor("adjust", other, "-o", folder).code == 2
        project.write_text(LEVELLING + "# a remark\n")
        os.utime(project, ns=(before.st_atime_ns, before.st_mtime_ns))
        assert mor("adjust", project).code == 2

    @pytest.mark.parametrize("spoilt", ["{", "[]", "{}", '{"identity": {"inputs": [{}]}}'])
    def test_not_where_results_cannot_be_read(self, tmp_path: Path, spoilt: str) -> None:
        project = write(tmp_path, LEVELLING)
        assert mor("adjust", project).code == 0
        (tmp_path / "project.results" / "results.json").write_text(spoilt)
        assert mor("adjust", project).code == 2

    def test_a_readme_of_the_user_stays(self, tmp_path: Path) -> None:
        project = write(tmp_path, LEVELLING)
        (tmp_path / "project.results").mkdir()
        (tmp_path / "project.results" / "README.txt").write_text("mine")
        assert mor("adjust", project, "--force").code == 0
        assert (tmp_path / "project.results" / "README.txt").read_text() == "mine"

    def test_refused_before_anything_is_computed(self, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
        project = write(tmp_path, LEVELLING)
        assert mor("adjust", project).code == 0
        project.write_text(LEVELLING + "# a remark\n")
        monkeypatch.setattr("mor.api.pipeline.solve_network", lambda *_: pytest.fail("adjusted all the same"))
        assert mor("adjust", project).code == 2

    def test_empty_folder_is_free(self, tmp_path: Path) -> None:
        (tmp_path / "out").mkdir()
        assert mor("adjust", write(tmp_path, LEVELLING), "-o", tmp_path / "out").code == 0

    def test_file_in_the_way(self, tmp_path: Path) -> None:
        project = write(tmp_path, LEVELLING)
        (tmp_path / "out").write_text("mine")
        run = mor("adjust", project, "-o", tmp_path / "out", "--force")
        assert run.code == 2
        assert "this is a file, expected a folder for the results" in run.err
        assert (tmp_path / "out").read_text() == "mine"

    def test_other_files_in_the_folder_stay(self, tmp_path: Path) -> None:
        (tmp_path / "out").mkdir()
        (tmp_path / "out" / "notes.txt").write_text("mine")
        assert mor("adjust", write(tmp_path, LEVELLING), "-o", tmp_path / "out", "--force").code == 0
        assert (tmp_path / "out" / "notes.txt").read_text() == "mine"

    def test_inputs_are_never_overwritten(self, tmp_path: Path) -> None:
        """The tables of the block are called like tables of results."""
        project = write_block(tmp_path)
        before = content(tmp_path)
        run = mor("adjust", project, "-o", tmp_path, "--force")
        assert run.code == 2
        assert run.err.splitlines() == [
            f"{tmp_path}/{name}: results would overwrite this file, from which the project is read; "
            "choose another folder"
            for name in ("images.csv", "points.csv")
        ]
        assert content(tmp_path) == before

    def test_adjusted_project_does_not_overwrite_itself(self, tmp_path: Path) -> None:
        assert mor("adjust", write(tmp_path, LEVELLING)).code == 0
        folder = tmp_path / "project.results"
        before = content(folder)
        assert mor("adjust", folder / "adjusted.yaml", "-o", folder, "--force").code == 2
        assert content(folder) == before

    def test_results_of_an_earlier_solution_do_not_stand_beside_a_failure(self, tmp_path: Path) -> None:
        project = write_block(tmp_path)
        assert mor("adjust", project).code == 0
        project.write_text(BLOCK.replace("datum: free\n", ""))
        assert mor("adjust", project, "--force").code == 4
        assert set(content(tmp_path / "project.results")) == {
            "README.txt",
            "results.json",
            "report.txt",
            "report.html",
        }


def write_folder(folder: Path, writers: Mapping[str, Writer], force: bool) -> None:
    with reserve(folder, force) as place:
        folder_module.write_folder(place, writers)


class TestInterruption:
    @pytest.mark.parametrize("error", [KeyboardInterrupt(), OSError(28, "No space left on device")])
    def test_no_new_folder_is_left(self, tmp_path: Path, error: BaseException) -> None:
        with pytest.raises((KeyboardInterrupt, InputError)):
            write_folder(tmp_path / "deep" / "out", {"a": say("a"), "b": fail(error)}, force=False)
        assert list(tmp_path.iterdir()) == []

    @pytest.mark.parametrize("error", [KeyboardInterrupt(), OSError(28, "No space left on device")])
    def test_old_results_stay_as_they_were(self, tmp_path: Path, error: BaseException) -> None:
        folder = tmp_path / "out"
        write_folder(folder, {"a": say("old a"), "b": say("old b")}, force=False)
        with pytest.raises((KeyboardInterrupt, InputError)):
            write_folder(folder, {"a": say("new a"), "b": fail(error)}, force=True)
        assert content(folder) == {"a": b"old a", "b": b"old b"}
        assert list(tmp_path.iterdir()) == [folder]

    def test_not_forced_is_checked_again_when_writing(self, tmp_path: Path) -> None:
        def meanwhile(path: Path) -> None:
            (tmp_path / "out").mkdir()
            (tmp_path / "out" / "a").write_text("mine")

        with pytest.raises(InputError):
            write_folder(tmp_path / "out", {"a": meanwhile}, force=False)
        assert content(tmp_path / "out") == {"a": b"mine"}
        assert list(tmp_path.iterdir()) == [tmp_path / "out"]

    def test_the_whole_command(self, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
        def interrupt(*_: object, **__: object) -> str:
            raise KeyboardInterrupt

        project = write(tmp_path, LEVELLING)
        monkeypatch.setattr("mor.report.results.text_report", interrupt)
        run = mor("adjust", project)
        assert run.code == 130
        assert run.err.splitlines()[-1] == "interrupted; no file was left incomplete"
        assert list(tmp_path.iterdir()) == [project]

    @pytest.mark.parametrize("said", [(28, "No space left on device"), ("No space left on device (os error 28)",)])
    def test_full_disk(self, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, said: tuple[object]) -> None:
        """Whether the system or polars says so."""

        def full(path: Path, *_: object, **__: object) -> None:
            raise OSError(*said)

        project = write(tmp_path, LEVELLING)
        monkeypatch.setattr(Path, "write_bytes", full)
        run = mor("adjust", project, "--lang", "de")
        assert run.code == 2
        place = tmp_path / "project.results" / "README.txt"
        said = "diese Datei kann nicht geschrieben werden: auf dem Datenträger ist kein Platz mehr"
        assert run.err.splitlines()[-1] == f"{place}: {said}"
        assert list(tmp_path.iterdir()) == [project]


class TestManifest:
    """What mor has written into a folder is listed there, and nothing else is ever touched."""

    @pytest.mark.parametrize("sample", slow_after(2, ["block", "dam_epochs", "dam", "three_line_strip"]))
    def test_lists_all_files_of_an_adjustment(self, tmp_path: Path, sample: str) -> None:
        samples = Path(__file__).parents[2] / "sample_projects"
        project = write_block(tmp_path) if sample == "block" else samples / sample / "project.yaml"
        assert mor("adjust", project, "-o", tmp_path / "results", "--no-html").code == 0
        listed = json.loads((tmp_path / "results" / "results.json").read_text())["files"]
        assert listed == sorted(path.name for path in (tmp_path / "results").iterdir())

    def test_files_of_the_user_stay_and_the_command_says_which(self, tmp_path: Path) -> None:
        project = write(tmp_path, LEVELLING)
        own = {"points.csv": "my points", "motions.csv": "my motions", "notes.txt": "my notes"}
        for name, text in own.items():
            (tmp_path / name).write_text(text)
        (tmp_path / "start_points").mkdir()
        run = mor("adjust", project, "-o", tmp_path, "--force")
        assert run.code == 2
        assert run.err.splitlines() == [
            f"{tmp_path / 'points.csv'}: this file exists, and no earlier results in this folder list it, "
            "so not even --force replaces it; choose another folder"
        ]
        assert {name: (tmp_path / name).read_text() for name in own} == own
        (tmp_path / "points.csv").unlink()
        assert mor("adjust", project, "-o", tmp_path, "--force").code == 0
        assert (tmp_path / "motions.csv").read_text() == "my motions"
        assert mor("adjust", project, "-o", tmp_path, "--force", "--tables", "none").code == 0
        assert not (tmp_path / "points.csv").exists(), "of the earlier run, and not written again"
        assert (tmp_path / "motions.csv").read_text() == "my motions"

    def test_a_folder_of_the_user_stays_the_same_folder(self, tmp_path: Path) -> None:
        """A shell that stands in it would be nowhere if it were exchanged for another one."""
        project, number = write(tmp_path, LEVELLING), tmp_path.stat().st_ino
        for _ in range(2):
            assert mor("adjust", project, "-o", tmp_path, "--force").code == 0
            assert tmp_path.stat().st_ino == number

    @pytest.mark.parametrize(
        "files",
        [
            ["../project.yaml", "points.csv"],
            ["/etc/passwd"],
            [".", "", "..", "a/../../project.yaml", 1, None, "\0"],
            "points.csv",
            None,
        ],
    )
    @pytest.mark.parametrize("name", ["results.json", "files.json"])
    def test_a_manifest_reaches_no_file_outside_its_folder(self, tmp_path: Path, name: str, files: object) -> None:
        project, folder = write(tmp_path, LEVELLING), tmp_path / "out"
        folder.mkdir()
        schema = {"results.json": "mor-results", "files.json": "mor-files"}[name]
        (folder / name).write_text(json.dumps({"schema": schema, "files": files}))
        mor("adjust", project, "-o", folder, "--force")
        assert project.read_text() == LEVELLING
        assert {path.name for path in tmp_path.iterdir()} == {"project.yaml", "out"}

    def test_a_readme_that_the_user_has_put_in_its_place_stays(self, tmp_path: Path) -> None:
        project = write(tmp_path, LEVELLING)
        for _ in range(3):
            assert mor("adjust", project, "--force").code == 0
            (tmp_path / "project.results" / "README.txt").write_text("mine")
        assert (tmp_path / "project.results" / "README.txt").read_text() == "mine"

    def test_other_commands_list_their_files_too(self, tmp_path: Path) -> None:
        project = write(tmp_path, LEVELLING)
        for command in ("approximate", "simulate", "design"):
            folder = tmp_path / command
            for _ in range(2):
                assert mor(command, project, "-o", folder, "--force").code in (0, 1)
            names = sorted(path.name for path in folder.iterdir())
            assert json.loads((folder / "files.json").read_text())["files"] == names
            (folder / "files.json").unlink()
            before = content(folder)
            assert mor(command, project, "-o", folder, "--force").code == 2
            assert content(folder) == before


def test_folder_can_be_read_by_others(tmp_path: Path) -> None:
    assert mor("adjust", write(tmp_path, LEVELLING)).code == 0
    assert (tmp_path / "project.results").stat().st_mode & 0o777 == 0o755


def test_start_values_never_overwrite_the_project_they_are_found_for(tmp_path: Path) -> None:
    """Nor a table of it that is called as a table of results is."""
    text = LEVELLING.replace("columns: [id, x, y, z], rows: [[A, 0, 0, 10]]", "file: points.csv")
    project = write(tmp_path, text, points="id,x,y,z\nA,0,0,10\n")
    before = {path.name: path.read_bytes() for path in tmp_path.iterdir()}
    run = mor("approximate", project, "-o", tmp_path, "--force")
    assert run.code == 2
    assert run.err.count("from which the project is read; choose another folder") == 1
    assert {path.name: path.read_bytes() for path in tmp_path.iterdir()} == before


AT_ONCE_OR_NOT = pytest.mark.parametrize("at_once", [True, False], ids=["exchanged", "one after the other"])


@pytest.fixture
def exchange(at_once: bool, monkeypatch: pytest.MonkeyPatch) -> None:
    if not at_once:
        monkeypatch.setattr(reservation, "_exchanged", lambda one, other: False)


@AT_ONCE_OR_NOT
@pytest.mark.usefixtures("exchange")
class TestExchange:
    def test_results_of_an_earlier_run_go_and_all_else_stays(self, tmp_path: Path) -> None:
        folder = tmp_path / "out"
        write_folder(folder, {"report.txt": say("old"), "start_points.csv": say("old")}, force=False)
        (folder / "notes").mkdir(mode=0o700)
        (folder / "notes" / "mine.txt").write_text("mine")
        (folder / "link").symlink_to("nowhere")
        folder.chmod(0o750)
        write_folder(folder, {"report.txt": say("new")}, force=True)
        assert {path.name for path in folder.iterdir()} == {"report.txt", "files.json", "notes", "link"}
        assert (folder / "report.txt").read_text() == "new"
        assert (folder / "notes" / "mine.txt").read_text() == "mine"
        assert os.readlink(folder / "link") == "nowhere"
        assert [path.stat().st_mode & 0o777 for path in (folder, folder / "notes")] == [0o750, 0o700]
        assert list(tmp_path.iterdir()) == [folder]

    def test_a_link_to_a_folder_stays_one(self, tmp_path: Path) -> None:
        (tmp_path / "link").symlink_to("out")
        for words in ("old", "new"):
            write_folder(tmp_path / "link", {"a": say(words)}, force=True)
        assert (tmp_path / "link").is_symlink()
        assert content(tmp_path / "out") == {"a": b"new"}

    def test_killed_before_every_step_the_next_run_finds_the_old_or_the_new(self, tmp_path: Path) -> None:
        """A process dies in the place of each call that changes something on disk, one after the other."""
        ended = set()
        for step in range(40):
            folder = tmp_path / str(step) / "out"
            write_folder(folder, {"a": say("old"), "b": say("old")}, force=False)
            (folder / "mine").write_text("mine")
            again = partial(write_folder, folder, {"a": say("new"), "b": say("new")}, force=True)
            died = _dying_at(step, again)
            with reserve(folder, force=True):
                found = content(folder)
            assert list(folder.parent.iterdir()) == [folder]
            assert found.pop("mine") == b"mine"
            assert found in ({"a": b"old", "b": b"old"}, {"a": b"new", "b": b"new"})
            ended.add(found["a"])
            if not died:
                break
        assert not died
        assert ended == {b"old", b"new"}


CHANGES = {
    "os.mkdir",
    "os.rename",
    "os.remove",
    "os.rmdir",
    "os.link",
    "open",
    "os.truncate",
    "shutil.rmtree",
}
"""Events that Python tells of before it changes something on disk (or reads a file)."""


def _dying_at(step: int, work: Callable[[], None]) -> bool:
    """Run the work in a process of its own that dies before its ``step``-th change of the disk, if it gets there."""
    with warnings.catch_warnings():  # the child touches nothing that another thread may hold
        warnings.simplefilter("ignore", DeprecationWarning)
        child = os.fork()
    if child == 0:
        left = [step]

        def watch(event: str, arguments: object) -> None:
            if event in CHANGES:
                if left[0] == 0:
                    os._exit(9)
                left[0] -= 1

        sys.addaudithook(watch)
        work()
        os._exit(0)
    return os.waitstatus_to_exitcode(os.waitpid(child, 0)[1]) == 9


class TestTwoRunsAtOnce:
    def test_the_second_is_told_before_it_works(self, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
        monkeypatch.setattr("mor.api.pipeline.solve_network", lambda *_: pytest.fail("adjusted all the same"))
        project, folder = write(tmp_path, LEVELLING), tmp_path / "project.results"
        with reserve(folder, force=False):
            for force in ((), ("--force",)):
                run = mor("adjust", project, *force)
                assert run.code == 2
                assert run.err == (
                    f"{folder}: another run of mor (process {os.getpid()}) is writing results into this folder; "
                    "wait for its end, or choose another folder\n"
                )

    def test_many_at_once_end_with_the_results_of_one(self, tmp_path: Path) -> None:
        """Each writes the same into two files; those that come too early are refused."""

        def one(number: int) -> bool:
            try:
                write_folder(tmp_path / "out", dict.fromkeys("ab", say(str(number))), force=True)
            except InputError:
                return False
            return True

        with ThreadPoolExecutor(8) as pool:
            written = list(pool.map(one, range(200)))
        assert any(written)
        found = content(tmp_path / "out")
        assert found["a"] == found["b"]
        assert list(tmp_path.iterdir()) == [tmp_path / "out"]


def _interrupted_at(line: int, folder: Path) -> bool:
    """Reserve a folder and put results in place, interrupted at a line of the module; whether there was that line."""
    lines = 0

    def trace(frame: FrameType, event: str, _: object) -> Callable[..., object]:
        nonlocal lines
        if event == "line" and frame.f_code.co_filename == reservation.__file__:
            lines += 1
            if lines == line:
                signal.raise_signal(signal.SIGINT)
        return trace

    before = sys.gettrace()
    sys.settrace(trace)
    try:
        with reservation.reserve(folder, force=True) as place:
            place.new.mkdir()
            (place.new / "report.txt").write_text("new")
            reservation.put_in_place(place)
    except KeyboardInterrupt:
        return True
    finally:
        sys.settrace(before)
    return lines >= line


def test_an_interruption_at_any_line_leaves_the_old_or_the_new_result_and_nothing_else(tmp_path) -> None:
    folder, line = tmp_path / "results", 0
    there = True
    while there:
        line += 1
        shutil.rmtree(tmp_path)
        folder.mkdir(parents=True)
        (folder / "report.txt").write_text("old")
        there = _interrupted_at(line, folder)
        assert list(tmp_path.iterdir()) == [folder], line
        assert [path.read_text() for path in folder.iterdir()] in (["old"], ["new"]), line
    assert line > 60, "all of the module's lines were interrupted"
