"""The gallery has every sample project with a picture, and its commands name files that exist."""

from __future__ import annotations

import re
from pathlib import Path

from tests.scenarios.small_projects import mor

ROOT = Path(__file__).parents[2]
DOCS = ROOT / "docs"
PAGE = (DOCS / "gallery.md").read_text(encoding="utf-8")
SECTIONS = {match[1]: match[2] for match in re.finditer(r"^## [^\n]*`(\w+)`\n(.*?)(?=^## |\Z)", PAGE, re.M | re.S)}


def test_every_sample_is_in_the_gallery() -> None:
    samples = {path.parent.name for path in (ROOT / "sample_projects").glob("*/project.yaml")}
    assert set(SECTIONS) == samples
    assert len(SECTIONS) == PAGE.count("\n## ")


def test_every_sample_has_its_picture_and_a_small_one() -> None:
    for name, section in SECTIONS.items():
        (picture,) = re.findall(r"!\[.+\]\((.*)\)", section)
        assert picture == f"images/gallery/{name}.png"
        assert (DOCS / picture).stat().st_size < 60_000
    assert len(list((DOCS / "images" / "gallery").iterdir())) == len(SECTIONS)


def test_commands_name_their_project() -> None:
    for name, section in SECTIONS.items():
        (command,) = re.findall(r"^    (mor .*)$", section, re.M)
        assert command == f"mor adjust sample_projects/{name}/project.yaml"
        assert "**The report shows**" in section
        assert mor("check", str(ROOT / command.split()[-1])).code == 0
