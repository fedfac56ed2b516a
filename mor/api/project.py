"""Projects: read from a file, or built of dictionaries and data frames."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from os import PathLike
from pathlib import Path
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from mor.input_files import ReadFile
    from mor.project.file.nodes import Document
    from mor.project.network.build import Network

Source = str | PathLike[str] | Mapping[str, Any]


@dataclass(frozen=True, eq=False)
class Project:
    """A project that was read: everything is checked, nothing is adjusted yet.

    Attributes:
        document: the plain data of the project file, with the places they stand at.
        network: blocks of unknowns, groups of observations, datum, start values, in internal units and axes.
        folder: where its tables are found from.
        files: what it was read from.
    """

    document: Document
    network: Network
    folder: Path
    files: tuple[ReadFile, ...] = ()

    @property
    def title(self) -> str:
        """Title of the project."""
        return self.network.project.title

    @property
    def notes(self) -> tuple[str, ...]:
        """Notes about assumptions made while the project was read."""
        return tuple(str(note) for note in self.network.notes)

    def __str__(self) -> str:
        from mor.report.results.contents import contents

        return contents(self.network)

    __repr__ = __str__


def read(source: Source, folder: str | PathLike[str] | None = None, form: str = "") -> Project:
    """Read and check a project.

    Args:
        source: a project file, a file or folder in a foreign format, or the project itself as a dictionary with the
            keys of a project file, in which a data frame may stand wherever a file of a table is named.
        folder: where the tables of a dictionary are found from; the current folder.
        form: format of a foreign file, as ``mor convert --from`` takes it, where its content shall not tell.

    Raises:
        InputError: with every mistake that was found: where it stands, what was found, what was expected.
    """
    from mor.input_files import files_read
    from mor.pipeline import read_document, read_network

    if isinstance(source, Mapping):
        from mor.api.built import build
        from mor.project.file.validation import without_empty_keys

        document, place = without_empty_keys(build(source)), Path(folder or ".")
        with files_read() as files:
            network = read_network(document, place)
    else:
        path = Path(source)
        with files_read() as files:
            document, place = read_document(path, form), path.parent
            network = read_network(document, place)
    return Project(document, network, place, tuple(files.values()))
