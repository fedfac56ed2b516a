"""Text tables of a DBAT project: where they are, columns by their declared format, ids that a filter leaves."""

from __future__ import annotations

from pathlib import Path
from typing import NamedTuple

from mor.errors import nearest
from mor.formats.draft import Draft, number
from mor.formats.text import read_lines
from mor.formats.xml import Element

_TEXTS = ("id", "im", "cam", "label", "path")
_SKIPPED = ("ignored", "dummy")


class Line(NamedTuple):
    """A line of a table: cells by their column, and where it stands."""

    cells: dict[str, str]
    line: int
    file: str


def table_of(
    given: Element, folder: Path, columns: tuple[str, ...], required: tuple[str, ...], draft: Draft
) -> list[Line]:
    """Lines of the file that a ``<file format="…">`` names; mistakes are told with the line they are in."""
    path = path_of(given, folder, draft)
    form = [name.strip() for name in given.attributes.get("format", "").split(",")]
    known = (*columns, *_SKIPPED)
    wrong = [name for name in form if name not in known]
    missing = [name for name in required if name not in form]
    if wrong or missing:
        words = f"found the format {given.attributes.get('format', '')!r}: "
        if wrong:
            words += f"{wrong[0]!r} is no column{nearest(wrong[0], known)} (known: {', '.join(known)})"
        else:
            words += f"expected {', '.join(missing)} in it"
        draft.problem(words, given.line)
    if path is None or wrong or missing:
        return []
    rows = []
    for count, text in enumerate(read_lines(path, draft), start=1):
        if not text.strip() or text.lstrip().startswith("#"):
            continue
        cells = [cell.strip() for cell in text.split(",")]
        if len(cells) != len(form):
            words = f"found {len(cells)} columns, expected {len(form)}: {', '.join(form)}"
            draft.problem(words, count, str(path))
            continue
        row = {name: cell for name, cell in zip(form, cells, strict=True) if name not in _SKIPPED}
        if _plain(row, count, str(path), draft):
            rows.append(Line(row, count, str(path)))
    return rows


def _plain(row: dict[str, str], line: int, file: str, draft: Draft) -> bool:
    """Return True if names are there and the rest are numbers."""
    try:
        for name, cell in row.items():
            if name in ("id", "im") and not cell:
                raise ValueError(f"found no {name}")
            if name not in _TEXTS and number(cell) < 0.0 and name.startswith("s"):
                raise ValueError(f"found the σ {cell}, expected 0 or more")
    except ValueError as error:
        draft.problem(str(error), line, file)
        return False
    return True


def path_of(given: Element, folder: Path, draft: Draft) -> Path | None:
    """The file an element names, from the folder of the input; a missing one is a mistake."""
    name = given.text.strip()
    if not name:
        draft.problem("found no name of a file", given.line)
        return None
    path = folder / name.replace("\\", "/")
    if path.is_file():
        return path
    draft.problem(f"the file {name} does not exist (looked for in {folder})", given.line)
    return None


def base_folder(given: Element, project: Path, draft: Draft) -> Path:
    """The folder that names of files count from: ``base_dir``, with $HERE for the folder of the project."""
    text = given.attributes.get("base_dir", "").strip()
    for word in ("$DBAT", "$HOME"):
        if text.startswith(word):
            words = (
                f"base_dir {text!r}: {word} is known to DBAT only; files are looked for beside the project"
            )
            draft.note(words, given.line)
            return project.parent
    text = text.replace("$HERE", ".", 1).replace("\\", "/")
    return project.parent / text if text else project.parent


def filtered(rows: list[Line], section: Element, draft: Draft) -> list[Line]:
    """Rows that the filters of a section keep."""
    for given in section.all("filter"):
        ids = {word.strip() for word in given.attributes.get("id", "").split(",")}
        what = given.text.strip()
        if what not in ("keep", "remove"):
            draft.problem(f"found the filter {what!r}, expected keep or remove", given.line)
            continue
        rows = [row for row in rows if (row.cells["id"] in ids) == (what == "keep")]
    return rows


def sigmas(row: Line) -> list[str | None]:
    """σ of x, y, z: its own column, that of the plane, that of all; ``None`` if there is none."""
    cells = row.cells
    plane = cells.get("sxy", cells.get("sxyz"))
    return [cells.get("sx", plane), cells.get("sy", plane), cells.get("sz", cells.get("sxyz"))]
