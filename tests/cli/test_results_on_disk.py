"""Results on disk: nothing overwritten unasked, nothing left half, inputs never touched."""

from __future__ import annotations

import os
from fnmatch import fnmatch
from pathlib import Path

import pytest
from small_projects import BLOCK, LEVELLING, mor, write, write_block

from mor.errors import InputError
from mor.report.results.folder import RESULT_FILES, write_folder


def content(folder: Path) -> dict[str, bytes]:
    return {path.name: path.read_bytes() for path in folder.iterdir() if path.is_file()}


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

    def test_refused_before_anything_is_computed(
        self, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
    ) -> None:
        project = write(tmp_path, LEVELLING)
        assert mor("adjust", project).code == 0
        monkeypatch.setattr("mor.pipeline.solve_network", lambda *_: pytest.fail("adjusted all the same"))
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
            f"{tmp_path}/{name}: results would overwrite this file, which the project is read from; "
            "choose another folder"
            for name in ("points.csv", "images.csv")
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
        assert set(content(tmp_path / "project.results")) == {"results.json", "report.txt"}


class TestInterruption:
    @pytest.mark.parametrize("error", [KeyboardInterrupt(), OSError(28, "No space left on device")])
    def test_no_new_folder_is_left(self, tmp_path: Path, error: BaseException) -> None:
        with pytest.raises(type(error)):
            write_folder(tmp_path / "out", {"a": say("a"), "b": fail(error), "c": say("c")}, force=False)
        assert list(tmp_path.iterdir()) == []

    @pytest.mark.parametrize("error", [KeyboardInterrupt(), OSError(28, "No space left on device")])
    def test_old_results_stay_as_they_were(self, tmp_path: Path, error: BaseException) -> None:
        folder = tmp_path / "out"
        write_folder(folder, {"a": say("old a"), "b": say("old b")}, force=False)
        with pytest.raises(type(error)):
            write_folder(folder, {"a": say("new a"), "b": fail(error)}, force=True)
        assert content(folder) == {"a": b"old a", "b": b"old b"}
        assert list(tmp_path.iterdir()) == [folder]

    def test_while_files_are_moved_into_place_every_file_is_whole(
        self, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
    ) -> None:
        folder = tmp_path / "out"
        write_folder(folder, {"a": say("old a"), "b": say("old b")}, force=False)
        replace, moved = os.replace, []

        def interrupted(source: Path, target: Path) -> None:
            if moved:
                raise KeyboardInterrupt
            moved.append(target)
            replace(source, target)

        monkeypatch.setattr("mor.report.results.folder.os.replace", interrupted)
        with pytest.raises(KeyboardInterrupt):
            write_folder(folder, {"a": say("new a"), "b": say("new b")}, force=True)
        assert content(folder) == {"a": b"new a", "b": b"old b"}
        assert list(tmp_path.iterdir()) == [folder]

    def test_not_forced_is_checked_again_when_writing(self, tmp_path: Path) -> None:
        (tmp_path / "out").mkdir()
        (tmp_path / "out" / "a").write_text("mine")
        with pytest.raises(InputError):
            write_folder(tmp_path / "out", {"a": say("a")}, force=False)
        assert content(tmp_path / "out") == {"a": b"mine"}

    def test_the_whole_command(self, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
        def interrupt(*_: object, **__: object) -> str:
            raise KeyboardInterrupt

        project = write(tmp_path, LEVELLING)
        monkeypatch.setattr("mor.report.results.writing.text_report", interrupt)
        run = mor("adjust", project)
        assert run.code == 130
        assert run.err.splitlines()[-1] == "interrupted; no file was left incomplete"
        assert list(tmp_path.iterdir()) == [project]

    def test_full_disk(self, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
        def full(path: Path, *_: object, **__: object) -> None:
            raise OSError(28, "No space left on device", str(path))

        project = write(tmp_path, LEVELLING)
        monkeypatch.setattr(Path, "write_text", full)
        run = mor("adjust", project)
        assert run.code == 2
        assert "No space left on device" in run.err
        assert list(tmp_path.iterdir()) == [project]


def test_all_results_are_known_as_such(tmp_path: Path) -> None:
    """What is not in the list would neither be taken away nor protected as an input."""
    assert mor("adjust", write_block(tmp_path)).code == 0
    for name in content(tmp_path / "project.results"):
        assert any(fnmatch(name, pattern) for pattern in RESULT_FILES), name


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
    assert run.err.count("which the project is read from; choose another folder") == 2
    assert {path.name: path.read_bytes() for path in tmp_path.iterdir()} == before
