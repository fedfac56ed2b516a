"""What is mutated: samples, small projects of every kind, public reference networks and foreign files."""

from __future__ import annotations

import tempfile
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path

from tests.reference_data import reference_folder
from tests.scenarios.kinds_of_projects import KINDS

_USUAL = 5_000.0
"""Bytes of a project that is taken as often as any smaller one; longer ones are taken more rarely."""


_CASES = Path(__file__).parents[2] / "cases"


@dataclass(frozen=True)
class Material:
    """A project: its files by name, and the one the command line is called with."""

    name: str
    main: str
    files: dict[str, bytes]

    @property
    def weight(self) -> float:
        """How often it is taken, so that a large project costs in all as much as a small one."""
        return 1.0 / (1.0 + sum(map(len, self.files.values())) / _USUAL)


def all_material() -> list[Material]:
    """Everything there is; reference networks only where the reference data are found."""
    return [
        *_kinds(),
        *_cases(),
        *_one_file("gama", "*.gkf"),
        *_one_file("textbook", "**/*.dat"),
        *_folders(),
    ]


def _kinds() -> Iterator[Material]:
    with tempfile.TemporaryDirectory() as temporary:
        for number, (name, make) in enumerate(KINDS.items()):
            project = make(Path(temporary) / str(number))
            named = {path.name: path for path in project.parent.iterdir() if path.is_file()}
            files = {name: path.read_bytes() for name, path in named.items() if _is_read(path)}
            yield Material(name, project.name, files)


def _cases() -> Iterator[Material]:
    """Small projects on which the program once went wrong."""
    for place in sorted(_CASES.iterdir()):
        if place.is_file():
            yield Material(f"case {place.stem}", place.name, {place.name: place.read_bytes()})
        elif (place / "project.yaml").is_file():
            files = {path.name: path.read_bytes() for path in sorted(place.iterdir()) if _is_read(path)}
            yield Material(f"case {place.name}", "project.yaml", files)


def _is_read(path: Path) -> bool:
    return path.suffix in (".yaml", ".csv")


def _one_file(folder: str, pattern: str) -> Iterator[Material]:
    found = reference_folder(folder)
    for path in sorted(found.glob(pattern)) if found else ():
        yield Material(f"{folder} {path.stem}", path.name, {path.name: path.read_bytes()})


def _folders() -> Iterator[Material]:
    """Reference data of several files, and one with a name that says nothing."""
    aicon, camcal = reference_folder("aicon-115"), reference_folder("camcal")
    if aicon:
        files = {path.name: path.read_bytes() for path in sorted(aicon.glob("example.*"))}
        yield Material("aicon", "example.ior", files)
    if camcal:
        text = (camcal / "camcal-pmexport.txt").read_bytes()
        yield Material("photomodeler", "camcal-pmexport.txt", {"camcal-pmexport.txt": text})
