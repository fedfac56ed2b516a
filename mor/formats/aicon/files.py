"""The flat files of one AICON project: found by a folder, a stem or one of them; lines of words without comments."""

from __future__ import annotations

import shlex
from pathlib import Path
from typing import NamedTuple

from mor.errors import InputError, Problem
from mor.formats.draft import Draft, number
from mor.input_files import read_text

REQUIRED = (".ior", ".eor", ".obc", ".phc")
SUFFIXES = (*REQUIRED, ".scale")


class Words(NamedTuple):
    """Words of a line, its number and its file."""

    words: list[str]
    line: int
    file: str


def stem_of(path: Path) -> Path:
    """Return the common beginning of all file names. Raises :class:`InputError` if a folder holds none or several."""
    if path.is_dir():
        stems = sorted({_bare(file) for file in path.iterdir() if _bare(file).suffix == ".ior"})
        if not stems:
            projects = sorted(file.name for file in path.glob("*.yaml"))
            hint = f"; did you mean {path.name}/{projects[0]}?" if projects else ""
            words = f"this is a folder, expected a project file, or one .ior file in it{hint}"
            raise InputError([Problem(words, str(path))])
        if len(stems) > 1:
            names = ", ".join(stem.name for stem in stems)
            words = f"found {len(stems)} .ior files ({names}) in this folder, expected one"
            raise InputError([Problem(words, str(path))])
        return stems[0].with_suffix("")
    bare = _bare(path)
    return bare.with_suffix("") if bare.suffix in SUFFIXES else bare


def is_stem(path: Path) -> bool:
    """True for what the names of the files begin with, itself no file."""
    names = (f"{path.name}.ior", f"{path.name}.ior.gz")
    return not path.exists() and any((path.parent / name).is_file() for name in names)


def _bare(path: Path) -> Path:
    return path.with_suffix("") if path.suffix == ".gz" else path


def read_words(stem: Path, suffix: str, draft: Draft) -> list[Words]:
    """Lines of one file, plain or gzipped; a missing file is a mistake where the format needs it."""
    for name in (f"{stem.name}{suffix}", f"{stem.name}{suffix}.gz"):
        path = stem.parent / name
        if not path.is_file():
            continue
        lines = enumerate(read_text(path, errors="replace").split("\n"), start=1)
        return [
            Words(_split(bare), i, str(path)) for i, line in lines if (bare := line.split("#")[0]).strip()
        ]
    if suffix in REQUIRED:
        draft.problem(
            "this file does not exist, plain or as .gz", file=str(stem.parent / f"{stem.name}{suffix}")
        )
    return []


def _split(line: str) -> list[str]:
    if '"' not in line:
        return line.split()
    try:
        return shlex.split(line)
    except ValueError:
        return line.split()


def numbers(line: Words, chosen: slice, draft: Draft) -> bool:
    """Return True if the chosen words are numbers; a mistake is reported otherwise."""
    try:
        for word in line.words[chosen]:
            number(word)
    except ValueError as error:
        draft.problem(str(error), line.line, line.file)
        return False
    return True


def enough(line: Words, count: int, form: str, draft: Draft) -> bool:
    """Return True if a line has at least ``count`` words; a mistake is reported otherwise."""
    if len(line.words) >= count:
        return True
    draft.problem(f"found {len(line.words)} columns, expected {form}", line.line, line.file)
    return False
