"""The German catalogue is complete, and numbers are written in the manner of the language, names are not touched."""

from __future__ import annotations

import ast
import string
from pathlib import Path

import pytest

import mor.cli
import mor.quality
import mor.report
from mor.api import batch
from mor.api.design import AS_IT_IS
from mor.model.parameters import KINDS
from mor.project.entities import FRAMES
from mor.quality import determinability as connected_components
from mor.quality import singularity as singularities
from mor.report import design as design_text
from mor.report import simulation as monte_carlo
from mor.report.language import ENGLISH, datum_name, words_of
from mor.report.layout import table
from mor.solve.datum import MOVEMENTS

CLI = Path(mor.cli.__file__).parent
REPORT = Path(mor.report.__file__).parent
QUALITY = Path(mor.quality.__file__).parent
OF_MOTIONS_AND_HYPOTHESES = {"nabla", "p", "parameter", "test", "freedom", "gain", "hypothesis"}
"""Headings that stand in tables of motions and of hypotheses only."""
SECTIONS = [
    *(REPORT / f"{name}.py" for name in ("text", "text_tables", "text_findings")),
    *(QUALITY / f"{name}.py" for name in ("determinability", "singularity", "assessment", "solution")),
    *(CLI / f"{name}.py" for name in ("progress", "adjust")),
]


def sentences(path: Path) -> set[str]:
    """Texts that a section says in the language of the report."""
    found = set()
    for node in ast.walk(ast.parse(path.read_text(encoding="utf-8"))):
        if not isinstance(node, ast.Call) or not node.args or not isinstance(node.args[0], ast.Constant):
            continue
        name = getattr(node.func, "id", getattr(node.func, "attr", ""))
        if name in ("words", "say", "phase"):
            found.add(str(node.args[0].value))
    return found


def headers(path: Path) -> set[str]:
    """Texts of lists that are called headers, without their units."""
    found = set()
    for node in ast.walk(ast.parse(path.read_text(encoding="utf-8"))):
        if isinstance(node, ast.Assign) and getattr(node.targets[0], "id", "") == "headers":
            constants = [part.value for part in ast.walk(node.value) if isinstance(part, ast.Constant)]
            found |= {str(text).partition(" [")[0] for text in constants} - {"", "]"}
    return found


PLANNING = [
    *(REPORT / f"{name}.py" for name in ("design", "simulation", "batch")),
    *(CLI / f"{name}.py" for name in ("design", "simulate", "batch")),
]


@pytest.mark.parametrize("path", PLANNING, ids=lambda path: f"{path.parent.name}-{path.stem}")
def test_every_sentence_of_plans_simulations_and_batches_is_there_in_german(path: Path) -> None:
    german = words_of("de", "planning").catalogue
    assert sorted((sentences(path) | headers(path)) - set(german)) == []


def test_what_plans_simulations_and_batches_call_things_is_there_in_german() -> None:
    named = {*design_text.WHAT.values(), *monte_carlo.NAMES.values(), *batch._STATUS.values(), AS_IT_IS}
    assert sorted(named - set(words_of("de", "planning").catalogue)) == []


@pytest.mark.parametrize("path", SECTIONS, ids=lambda path: path.stem)
def test_every_sentence_and_heading_is_there_in_german(path: Path) -> None:
    german = words_of("de").catalogue
    assert sorted((sentences(path) | headers(path)) - set(german) - OF_MOTIONS_AND_HYPOTHESES) == []


def test_what_is_put_into_sentences_is_there_in_german() -> None:
    names = {
        *MOVEMENTS,
        *connected_components._NAMED,
        *(f"{name}s" for name in connected_components._NAMED),
        *FRAMES,
    }
    kinds = {kind for kind in KINDS if not kind.startswith("interior/")} | {"position"}
    assert sorted((names | kinds | set(singularities._CURES.values())) - set(words_of("de").catalogue)) == []


@pytest.mark.parametrize(
    ("name", "german"),
    [
        ("fixed", "fest"),
        ("free, inner constraints over all points", "freies Netz, Gesamtspurminimierung über alle Punkte"),
        (
            "free, inner constraints over x, y of 12 named points or groups and z of 3 named points or groups",
            "freies Netz, Teilspurminimierung über x, y von 12 genannten Punkten oder Gruppen "
            "und z von 3 genannten Punkten oder Gruppen",
        ),
        ("minimal, xyz of A, xy of B of C, 1.5, z of D", "minimal, xyz von A, xy von B of C, 1.5, z von D"),
    ],
)
def test_datum_names(name: str, german: str) -> None:
    assert datum_name(name, words_of("de")) == german
    assert datum_name(name, ENGLISH) == name


def test_the_sections_were_really_looked_at() -> None:
    assert len(set().union(*map(sentences, SECTIONS))) > 40


@pytest.mark.parametrize("catalogue", [words_of("de").catalogue, words_of("de", "page").catalogue])
def test_sentences_keep_their_places(catalogue: dict[str, str]) -> None:
    """Both languages have the same {places}."""
    for english, german in catalogue.items():
        places = [{name for _, name, _, _ in string.Formatter().parse(text) if name} for text in (english, german)]
        assert places[0] == places[1], english


@pytest.mark.parametrize(
    ("text", "german"),
    [
        ("1.5", "1,5"),
        ("-0.30", "-0,30"),
        ("1.2e-05", "1,2e-05"),
        ("17", "17"),
        ("a.b", "a.b"),
        ("-", "-"),
        ("1.2.3", "1.2.3"),
    ],
)
def test_numbers(text: str, german: str) -> None:
    assert words_of("de").number(text) == german
    assert ENGLISH.number(text) == text


def test_names_stay_names() -> None:
    words = words_of("de")
    said = words("; would move {point} by {amount} {unit} in {axis}", point="1.5", amount="2.5", unit="mm", axis="X")
    assert said == "; würde 1.5 um 2,5 mm in X verschieben"
    lines = table(["point", "X [m]", "status"], [["1.5", "2.5", "fixed"], ["free", "1.0", "free"]], words=words)
    cells = [line.split() for line in lines.splitlines()]
    assert cells[0] == ["Punkt", "X", "[m]", "Status"]
    assert cells[2:] == [["1.5", "2,5", "fest"], ["free", "1,0", "frei"]]
