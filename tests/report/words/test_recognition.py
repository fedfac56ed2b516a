"""Finished sentences are recognised, their values and names stay, clauses within them are said in turn."""

from __future__ import annotations

from pathlib import Path

import pytest

from mor.report.language import ENGLISH, Sentences, words_of
from tests.scenarios.small_projects import LEVELLING, mor, write

GERMAN = words_of("de")


@pytest.mark.parametrize(
    ("english", "german"),
    [
        ("unknown camera 'D7'", "unbekannte Kamera 'D7'"),
        ("unknown camera 'D8'; did you mean 'D7'?", "unbekannte Kamera 'D8'; ist 'D7' gemeint?"),
        ("found 3 columns, expected 4", "gefunden 3 Spalten, erwartet 4"),
        ("x: found nothing, expected a whole number", "x: gefunden nichts, erwartet eine ganze Zahl"),
        (
            "12 rays not used: B7 is switched off or does not exist",
            "12 Strahlen nicht verwendet: B7 ist abgeschaltet oder fehlt",
        ),
        ("image B7: no observation refers to it", "Bild B7: keine Beobachtung betrifft es"),
        ("settings: found 'no', expected true or false", "settings: gefunden 'no', erwartet true oder false"),
        ("nobody has ever said this of 7 things", "nobody has ever said this of 7 things"),
    ],
)
def test_sentences(english: str, german: str) -> None:
    assert GERMAN.told(english) == german
    assert ENGLISH.told(english) == english


@pytest.mark.parametrize("name", ["point", "free", "found 1, expected 2", "a; did you mean 'b'?", "it's", "x: y, z"])
def test_a_name_in_quotes_stays_whatever_it_says(name: str) -> None:
    assert GERMAN.told(f"unknown camera {name!r}") == f"unbekannte Kamera {name!r}"


def test_a_single_word_changes_only_where_its_place_is_marked() -> None:
    said = Sentences({"{} of {}": "{} von {}", "found {}": "gefunden {:w}", "point": "Punkt"})
    assert said.say("found point") == "gefunden Punkt"
    assert said.say("point of point") == "point von point"


def test_of_two_sentences_that_fit_the_one_that_says_more_is_meant() -> None:
    said = Sentences({"{} is fixed": "{} ist fest", "point {} is fixed": "Punkt {} ist fest"})
    assert said.say("point A is fixed") == "Punkt A ist fest"


def test_a_value_twice_is_the_same_twice() -> None:
    said = Sentences({"{0} is {0}": "{0} bleibt {0}"})
    assert said.say("A is A") == "A bleibt A"
    assert said.say("A is B") == "A is B"


def test_mistakes_of_a_project_with_their_places(tmp_path: Path) -> None:
    path = write(tmp_path, LEVELLING.replace("fixed: [x, y, z]", "fixd: [x, y, z]"))
    english, german = (mor("check", path, "--lang", lang) for lang in ("en", "de"))
    assert english.code == german.code == 2
    assert "unknown key 'fixd'; did you mean 'fixed'?" in english.err
    assert "unbekannter Schlüssel 'fixd'; ist 'fixed' gemeint?" in german.err
    assert english.err.split(" unknown")[0] == german.err.split(" unbekannter")[0]  # file and line


def test_what_a_project_contains(tmp_path: Path) -> None:
    said = mor("check", write(tmp_path, LEVELLING), "--lang", "de").out
    assert "Punkte" in said
    assert "Beobachtungen" in said


def test_the_variable_is_the_language_of_every_command(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("MOR_LANG", "de")
    assert mor("check", "nowhere.yaml").err == "nowhere.yaml: diese Datei gibt es nicht\n"
    assert mor("chek").err.endswith("Fehler: es gibt keinen Befehl 'chek'; ist 'check' gemeint?\n")
    assert mor("check", "nowhere.yaml", "--lang", "en").err == "nowhere.yaml: this file does not exist\n"


def test_help() -> None:
    said = mor("check", "--lang", "de", "--help").out
    assert "Aufruf: mor check [OPTIONEN] PROJECT" in said
    assert "Beispiele:\n    mor check project.yaml\n" in said
    assert "Nur Fehler ausgeben." in said
    assert "Usage: mor check [OPTIONS] PROJECT" in mor("check", "--help").out
