"""One mutant: a project with one mutation or several, and the command it is run with, all from two numbers."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from pathlib import PurePath

import numpy as np

from .cells import mutated_table
from .lines import mutated_bytes, mutated_lines
from .material import Material
from .structure import mutated_project
from .values import chosen, hostile


@dataclass(frozen=True)
class Mutant:
    """Files by name, the one that is named on the command line, and what stands there beside it."""

    number: int
    material: str
    main: str
    files: dict[str, bytes]
    command: tuple[str, ...]


def mutant(materials: Sequence[Material], seed: int, number: int) -> Mutant:
    """Mutant ``number`` of a run: the same files for the same seed, whoever makes it."""
    if number < 0:  # the projects themselves: what is wrong with them, and all that is compiled once
        base = materials[-number - 1]
        return Mutant(number, base.name, base.main, base.files, ("adjust", "--tables", "all", "--html"))
    rng = np.random.default_rng([seed, number])
    weights = np.array([material.weight for material in materials])
    base = materials[int(rng.choice(len(materials), p=weights / weights.sum()))]
    projects = [m for m in materials if m.main.endswith(".yaml")]
    files = dict(base.files)
    for _ in range(int(chosen(rng, (1, 1, 1, 1, 2, 2, 3, 5)))):  # type: ignore[call-overload]
        name = base.main if rng.random() < 0.6 else str(chosen(rng, sorted(files)))
        donor = projects[int(rng.integers(len(projects)))]
        files[name] = _mutation(rng, name)(rng, files[name], donor.files[donor.main])
    if rng.random() < 0.1:
        files = _renamed(rng, files, base.main)
    return Mutant(number, base.name, base.main, files, _command(rng))


def _mutation(rng: np.random.Generator, name: str) -> Callable[[np.random.Generator, bytes, bytes], bytes]:
    """What is done to a file, by its kind."""
    kind, draw = PurePath(name).suffix, rng.random()
    if kind == ".yaml" and draw < 0.85:
        return mutated_project
    if kind == ".csv" and draw < 0.8:
        return lambda rng, content, _: mutated_table(rng, content)
    if draw < 0.95:
        return lambda rng, content, _: mutated_lines(rng, content)
    return lambda rng, content, _: mutated_bytes(rng, content)


def _renamed(rng: np.random.Generator, files: dict[str, bytes], main: str) -> dict[str, bytes]:
    """One word of the project gets another name in all of its files."""
    words = [word for word in files[main].replace(b'"', b" ").split() if word.isalnum() and len(word) < 12]
    if not words:
        return files
    old, new = bytes(chosen(rng, words)), hostile(rng).encode()  # type: ignore[call-overload]
    return {name: content.replace(old, new) for name, content in files.items()}


def _command(rng: np.random.Generator) -> tuple[str, ...]:
    """Mostly ``adjust``, with some of its options."""
    draw = rng.random()
    if draw < 0.06:
        return ("check",)
    if draw < 0.10:
        return ("approximate",)
    if draw < 0.14:
        return ("convert",)
    options: list[str] = ["adjust", "--tables", str(chosen(rng, ("none", "worst", "all", "all")))]
    options += ["--html" if rng.random() < 0.1 else "--no-html"]
    for option, share in (
        (("--lang", "de"), 0.2),
        (("--snoop",), 0.1),
        (("--json",), 0.05),
        (("--strict",), 0.2),
    ):
        if rng.random() < share:
            options += option
    return tuple(options)
