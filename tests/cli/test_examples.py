"""``mor examples``: every sample can be had, is complete and adjusts."""

from __future__ import annotations

import tomllib
from pathlib import Path

import pytest

from mor.cli import run
from tests.scenarios.small_projects import mor

ROOT = Path(__file__).parents[2]
NAMES = sorted(path.parent.name for path in (ROOT / "sample_projects").glob("*/project.yaml"))


def test_list_names_every_sample_with_its_title(capsys: pytest.CaptureFixture[str]) -> None:
    assert run(["examples"]) == 0
    lines = capsys.readouterr().out.splitlines()
    assert [line.split()[0] for line in lines] == NAMES
    assert all(len(line.split(maxsplit=1)[1]) > 10 for line in lines)


@pytest.mark.parametrize("name", NAMES)
def test_a_copy_is_complete(name: str, tmp_path: Path) -> None:
    target = tmp_path / "copy"
    assert run(["examples", name, "-o", str(target)]) == 0
    assert run(["check", str(target / "project.yaml"), "--quiet"]) == 0
    assert not (target / "expected.json").exists()


def test_unknown_sample(capsys: pytest.CaptureFixture[str]) -> None:
    assert run(["examples", "fasade"]) == 2
    assert "did you mean 'facade'" in capsys.readouterr().err


def test_nothing_is_overwritten(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    (tmp_path / "mine.txt").write_text("mine")
    assert run(["examples", "facade", "-o", str(tmp_path)]) == 2
    assert "not an empty folder" in capsys.readouterr().err
    assert [path.name for path in tmp_path.iterdir()] == ["mine.txt"]


def test_the_wheel_ships_every_sample() -> None:
    settings = tomllib.loads((ROOT / "pyproject.toml").read_text(encoding="utf-8"))
    shipped = settings["tool"]["hatch"]["build"]["targets"]["wheel"]["force-include"]
    samples = {source: target for source, target in shipped.items() if source.startswith("sample_projects/")}
    assert samples == {f"sample_projects/{name}": f"mor/examples/{name}" for name in NAMES}


def test_a_copy_that_is_there_already_is_enough(tmp_path: Path) -> None:
    assert mor("examples", "facade", "-o", tmp_path / "mine").code == 0
    (tmp_path / "mine" / "project.results").mkdir()
    assert mor("examples", "facade", "-o", tmp_path / "mine").code == 0
    with (tmp_path / "mine" / "project.yaml").open("a") as file:
        file.write("# mine\n")
    assert mor("examples", "facade", "-o", tmp_path / "mine").code == 2
