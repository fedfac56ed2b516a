"""The tutorials: every command is run, every output shown is the real one, every number in the text is in an output."""

from __future__ import annotations

import importlib.util
import re
from pathlib import Path
from types import ModuleType

import pytest

pytest.importorskip("matplotlib")
DOCS = Path(__file__).parents[2] / "docs"
PAGES = sorted((DOCS / "tutorials").glob("*.md"))
FENCE = re.compile(r"^```.*?^```$", re.M | re.S)
NUMBER = re.compile(r"(?<![\w.])\d+\.\d+(?![\w.]*\d)")


@pytest.fixture(scope="module")
def tutorials() -> ModuleType:
    spec = importlib.util.spec_from_file_location("run_tutorials", DOCS / "run_tutorials.py")
    assert spec is not None
    assert spec.loader is not None
    module = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(module)
    return module


@pytest.mark.slow
@pytest.mark.parametrize("path", PAGES, ids=lambda path: path.stem)
def test_page_shows_what_the_program_says(tutorials: ModuleType, path: Path, tmp_path: Path) -> None:
    page = path.read_text(encoding="utf-8")
    outcome = tutorials.run_page(page, tmp_path)
    different = [
        f"{what}: shown {shown}, now {tutorials.renewed(shown, found)}" for what, shown, found in outcome.mismatches
    ]
    assert different == [], "python docs/run_tutorials.py --write puts in what the program says now"
    known = set(NUMBER.findall("\n".join([*outcome.outputs, *FENCE.findall(page)])))
    assert [number for number in NUMBER.findall(FENCE.sub("", page)) if number not in known] == []


def test_there_is_one_for_each_kind_of_job() -> None:
    assert {path.stem for path in PAGES} == {
        "aerial-strip",
        "calibration-field",
        "dam",
        "dam-epochs",
        "facade",
        "machine-part",
        "planning",
        "rolling-shutter",
        "theodolite-network",
    }


def test_excerpts_agree_only_with_what_is_there(tutorials: ModuleType) -> None:
    found = ["a  1", "b 2", "c 3.25"]
    assert tutorials.agrees(found, found)
    assert tutorials.agrees(["a 1", "…"], found)
    assert tutorials.agrees(["…", "c…"], found)
    assert not tutorials.agrees(["a 1"], found)
    assert not tutorials.agrees(["…", "c 3"], found)
    assert not tutorials.agrees(["…", "b 2", "a 1", "…"], found)
    assert not tutorials.agrees([], found)
    assert tutorials.agrees(["…", "c 3.26"], found), "one unit of the last digit"
    assert not tutorials.agrees(["…", "c 3.27"], found)
    assert tutorials.agrees(["-0.0000 1.8972e-06 x"], ["0.0000  0.0000018972001 x"])
    assert tutorials.agrees(["Converged after 5 iterations."], ["Converged after 6 iterations."])
    assert not tutorials.agrees(["b 0.123456789"], ["b 0.123466789"])


def test_renewed_excerpt_keeps_its_lines_with_new_numbers(tutorials: ModuleType) -> None:
    shown = ["…", "c  20.4177 0.0004", "…", "sum 0.1…"]
    found = ["head", "c  21.5 0.0005", "xh 0.1 0.2", "sum 0.2 and more"]
    assert tutorials.renewed(shown, found) == ["…", "c  21.5 0.0005", "…", "sum 0.2…"]


def test_change_must_fit_its_file(tutorials: ModuleType, tmp_path: Path) -> None:
    file = tmp_path / "p.yaml"
    file.write_text("a: 1\nb: 2\na: 3\n", encoding="utf-8")
    tutorials.change(tmp_path, ["--- p.yaml", " b: 2", "+c: 4", "@@", "-a: 1", "+a: 0"])
    assert file.read_text(encoding="utf-8") == "a: 0\nb: 2\nc: 4\na: 3\n"
    with pytest.raises(ValueError, match="0 places"):
        tutorials.change(tmp_path, ["--- p.yaml", "-d: 2"])
