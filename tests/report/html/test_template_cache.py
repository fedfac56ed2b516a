"""Compiled templates in the cache: whole, damaged, or where nothing can be written."""

from collections.abc import Callable
from pathlib import Path

import jinja2
import pytest

from mor.report.page import environment


@pytest.fixture
def cache(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """The folder of compiled templates of the test."""
    monkeypatch.setenv("NUMBA_CACHE_DIR", str(tmp_path))
    return tmp_path / "mor" / "templates"


def rendered() -> str:
    """A template of the page, as a new process would have it."""
    template = environment().get_template("verdict.html.j2")
    return template.render(headline={"state": "good", "title": "Accepted"}, parts=[], steps=["none"], say=str)


def test_a_template_is_compiled_once(cache: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    first = rendered()
    assert len(list(cache.iterdir())) == 1

    def compiled(*_: object) -> None:
        raise AssertionError

    monkeypatch.setattr(jinja2.Environment, "compile", compiled)
    assert rendered() == first


@pytest.mark.parametrize("damage", [lambda content: content[:-9], lambda _: b"", lambda content: content + b"x"])
def test_a_damaged_file_is_not_used(cache: Path, damage: Callable[[bytes], bytes]) -> None:
    first = rendered()
    (file,) = cache.iterdir()
    whole = file.read_bytes()
    file.write_bytes(damage(whole))
    assert rendered() == first
    assert file.read_bytes() == whole


def test_a_page_needs_no_home_folder(monkeypatch: pytest.MonkeyPatch) -> None:
    def no_home() -> Path:
        raise RuntimeError

    monkeypatch.setattr(Path, "home", no_home)
    assert rendered()


def test_a_page_needs_no_cache(cache: Path) -> None:
    cache.parent.mkdir(parents=True)
    cache.write_text("no folder")
    assert rendered()
