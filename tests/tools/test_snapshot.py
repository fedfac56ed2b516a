"""tools/snapshot.py: what compare reports, on small hand-made snapshots, and what make records."""

from __future__ import annotations

import json
import lzma
import sys
from pathlib import Path
from typing import Any

import pytest

from tools import snapshot

ROOT = Path(__file__).resolve().parents[2]

POINTS = "id,x,sx,rxy\nA,1000.25,0.002,0.1\nB,2000.5,0.004,1e-17\n"
RUN = {
    "main": "project.yaml",
    "options": ["--no-html"],
    "inputs": {"project.yaml": "c0ffee"},
    "outcome": 0,
    "seconds": 1.0,
    "stdout": "",
    "stderr": "Converged after 7 iterations.\nsigma0 a posteriori 1.0238\n",
    "files": {
        "out/points.csv": POINTS,
        "out/results.json": '{"program": "mor 0.1.0", "points": [{"id": "A", "x": 1000.25, "sx": 0.002}]}',
        "out/report.txt": "Point A: 1000.250\nAccepted.\n",
    },
}


def record(**changes: Any) -> dict[str, Any]:
    """Return the run above with some values changed; of ``files`` only those given."""
    files = {f"out/{name}": text for name, text in changes.pop("files", {}).items()}
    changed = {**RUN, **changes, "files": {**RUN["files"], **files}}  # type: ignore[dict-item]
    changed["files"] = {name: text for name, text in changed["files"].items() if text is not None}
    return changed


@pytest.fixture
def compared(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> Any:
    """Compare the run above with another one; return the exit code and what is printed."""

    def compare(new: dict[str, Any], *options: str, only: tuple[str, ...] = ("*",)) -> tuple[int, str]:
        runs = {"old": {"samples/a": RUN}, "new": {"samples/a": new}}
        if only != ("*",):
            runs["old"]["cases/b"] = RUN
        for name, content in runs.items():
            header = {"only": list(only) if name == "new" else ["*"]}
            with lzma.open(tmp_path / name, "wt") as file:
                json.dump({"header": header, "contents": {}, "runs": content}, file)
        code = snapshot.main(["compare", str(tmp_path / "old"), str(tmp_path / "new"), *options])
        return code, capsys.readouterr().out

    return compare


def test_equal_snapshots(compared: Any) -> None:
    assert compared(record()) == (0, "\n1 runs compared. No differences.\n")


def test_exit_codes_come_first(compared: Any) -> None:
    code, out = compared(record(outcome=3, stderr="Not converged.\n", files={"points.csv": None}))
    assert code == 1
    assert "samples/a: 0 -> 3" in out
    assert out.index("Exit codes: 1") < out.index("Messages: 2") < out.index("Files: 1")
    assert "samples/a out/points.csv: written -> not written" in out


@pytest.mark.parametrize(
    ("old", "new", "bound", "within"),
    [
        ("1000.25", "1000.2500001", "", False),
        ("1000.25", "1000.2500001", "1e-9", True),
        ("1000.25", "1000.250002", "1e-9", False),
        ("1000.25", "1000.2500001", "1e-4sigma", True),
        ("1000.25", "1000.2500003", "1e-4sigma", False),
        ("1e-17", "-3e-17", "1e-9", False),
        ("1e-17", "-3e-17", "1e-9,1e-15column", True),
        ("1e-17", "-3e-17", "1e-16abs", True),
        ("1e-17", "nan", "1e9", False),
        ("1000.25", "free", "1e9", False),
        ("1000.25", "1000.2500001", "*:x=1e-12", False),
        ("1000.25", "1000.2500001", "*:sx=1e-12", False),
        ("1000.25", "1000.2500001", "results.json:*=1e-9", False),
        ("1000.25", "1000.2500001", "points.csv:x=1e-9", True),
    ],
)
def test_numbers_within_and_beyond_a_bound(compared: Any, old: str, new: str, bound: str, within: bool) -> None:
    options = ["--bound", bound] if bound else []
    code, out = compared(record(files={"points.csv": POINTS.replace(old, new)}), *options)
    assert code == int(not within)
    assert within or f"{old} -> {new}" in out or f"- {old}" in out


def test_the_last_bound_that_fits_counts(compared: Any) -> None:
    new = record(files={"points.csv": POINTS.replace("1000.25", "1000.2500001")})
    assert compared(new, "--bound", "1e-12", "*:x=1e-9")[0] == 0
    assert compared(new, "--bound", "*:x=1e-9", "*:*=1e-12")[0] == 1
    assert compared(new, "--bound", "1e-12", "--ignore", "points.csv:x")[0] == 0


def test_round_off(compared: Any) -> None:
    new = POINTS.replace("1000.25", "1000.2500000001").replace("1e-17", "-2e-18")
    assert compared(record(files={"points.csv": new}), "--round-off")[0] == 0
    assert compared(record(files={"points.csv": POINTS.replace("0.1\n", "0.1001\n")}), "--round-off")[0] == 1


def test_rows_are_compared_by_name(compared: Any) -> None:
    header, a, b = POINTS.splitlines()
    swapped = record(files={"points.csv": f"{header}\n{b}\n{a}\n"})
    code, out = compared(swapped)
    assert code == 1
    assert "written in another form or order" in out
    assert compared(swapped, "--bound", "1e-9")[0] == 0
    code, out = compared(record(files={"points.csv": f"{header}\n{a}\n"}), "--bound", "1e-9")
    assert code == 1
    assert "Rows: 4 in 1 run" in out  # the four cells of B


def test_a_number_in_json_is_shown_with_its_place(compared: Any) -> None:
    changed = RUN["files"]["out/results.json"].replace("1000.25", "1000.5")  # type: ignore[index]
    code, out = compared(record(files={"results.json": changed}))
    assert code == 1
    assert "samples/a results.json:points.x: 1 differ, at most by 2.5e-04 of the value; A: 1000.25 -> 1000.5" in out


def test_texts_differ_by_a_last_digit_or_a_word(compared: Any) -> None:
    last_digit = record(stderr=RUN["stderr"].replace("1.0238", "1.0239"))  # type: ignore[attr-defined]
    assert compared(last_digit)[0] == 1
    assert compared(last_digit, "--bound", "1e-9")[0] == 0
    count = record(stderr=RUN["stderr"].replace("7", "8"))  # type: ignore[attr-defined]
    assert compared(count, "--bound", "1e-9")[0] == 1
    word = record(files={"report.txt": "Point A: 1000.250\nRejected.\n"})
    code, out = compared(word, "--bound", "1e-9")
    assert code == 1
    assert "- Accepted." in out
    assert "+ Rejected." in out


def test_versions_do_not_count(compared: Any) -> None:
    changed = RUN["files"]["out/results.json"].replace("mor 0.1.0", "mor 0.2.0.dev1")  # type: ignore[index]
    assert compared(record(files={"results.json": changed}))[0] == 0


def test_changed_inputs_are_reported(compared: Any) -> None:
    code, out = compared(record(inputs={"project.yaml": "5eed"}))
    assert code == 1
    assert "samples/a project.yaml: c0ffee -> 5eed" in out


def test_runs_that_were_not_asked_for_are_no_difference(compared: Any) -> None:
    assert compared(record(), only=("samples",))[0] == 0
    code, out = compared(record(), only=("samples", "cases"))
    assert code == 1
    assert "cases/b: run -> no run" in out


def test_times(compared: Any) -> None:
    out = compared(record(seconds=2.5), "--times")[1]
    assert "samples                      1       1.0       2.5    2.50    2.50" in out


def test_a_malformed_bound_and_a_malformed_file_are_refused(compared: Any, tmp_path: Path) -> None:
    with pytest.raises(SystemExit, match="found '1e-9metres', expected a number"):
        compared(record(), "--bound", "1e-9metres")
    (tmp_path / "text").write_text("no snapshot")
    with pytest.raises(SystemExit, match="text: not a snapshot"):
        snapshot.main(["compare", str(tmp_path / "text"), str(tmp_path / "text")])


PROGRAM = """
import pathlib, sys
project = pathlib.Path(sys.argv[2])
while "slow" in project.read_text():
    pass
print("in", pathlib.Path.cwd())
print("mor 9.9.9", file=sys.stderr)
pathlib.Path("out").mkdir()
pathlib.Path("out/points.csv").write_text("id,x\\nA,1\\n")
project.write_text("changed")
pathlib.Path("table.csv").unlink()
sys.exit(3)
"""


def test_make_records_outcome_messages_files_and_changed_inputs(tmp_path: Path) -> None:
    for name, text in (("fast", "a project"), ("slow", "slow")):
        folder = tmp_path / "tree" / "tests" / "cases" / name
        folder.mkdir(parents=True)
        (folder / "project.yaml").write_text(text)
        (folder / "table.csv").write_text("a,b\n")
    program = tmp_path / "program.py"
    program.write_text(PROGRAM)
    out = tmp_path / "a.json.xz"
    command = ["make", str(out), "--inputs", str(tmp_path / "tree"), "--only", "cases", "--limit", "1"]
    snapshot.main([*command, "--mor", f'"{sys.executable}" "{program}"'])
    runs = snapshot.load(out)["runs"]
    assert runs["cases/slow"]["outcome"] == "time limit"
    fast = runs["cases/fast"]
    assert (fast["outcome"], fast["stdout"], fast["stderr"]) == (3, "in FOLDER\n", "mor 9.9.9\n")
    assert fast["files"] == {
        "out/points.csv": "id,x\nA,1\n",
        "project.yaml": "changed",
        "table.csv": "(the program deleted this input)",
    }
    assert (tmp_path / "tree/tests/cases/fast/project.yaml").read_text() == "a project"
    stored = snapshot.stored_inputs(snapshot.load(out), ["cases/fast"])
    assert stored == snapshot.inputs_of(tmp_path / "tree", tmp_path, ["cases/fast"])


def test_make_of_the_smallest_sample(tmp_path: Path) -> None:
    out = tmp_path / "a.json.xz"
    snapshot.main(["make", str(out), "--only", "samples/bridge", "--mor", f'"{sys.executable}" -m mor'])
    run = snapshot.load(out)["runs"]["samples/bridge"]
    assert run["outcome"] == 0
    assert "Converged" in run["stderr"]
    assert {
        "out/results.json",
        "out/points.csv",
        "out/residuals.csv",
        "out/report.txt",
        "out/report.html",
    } <= {*run["files"]}
    assert str(tmp_path) not in json.dumps(run)


@pytest.mark.slow
@pytest.mark.skipif(sys.platform == "win32", reason="there is no fork on Windows")
def test_forks_and_new_processes_write_the_same_bytes(tmp_path: Path) -> None:
    old, new = tmp_path / "old.json.xz", tmp_path / "new.json.xz"
    inputs = "samples/bridge,cases/control_crash_70,cases/vectors_crash_70"
    snapshot.main(["make", str(old), "--only", inputs])
    snapshot.main(["make", str(new), "--inputs", str(old), "--mor", f'"{sys.executable}" -m mor'])
    assert len(snapshot.load(new)["runs"]) == 3
    assert snapshot.main(["compare", str(old), str(new)]) == 0
