"""How much memory a project takes, before its tables are read, and how large domains may be for a given amount.

The coefficients were measured: largest resident sizes of the whole command on simulated blocks (docs/scaling.md).
"""

from __future__ import annotations

import os
from collections.abc import Sequence
from pathlib import Path

import polars as pl

from mor.errors import InputError, OutOfMemoryError
from mor.errors import Problem as Mistake
from mor.project.file.model import Project
from mor.project.file.nodes import Document

PROGRAM = 330e6
"""Bytes that the program takes with its libraries and compiled kernels."""
OF_RAY, OF_RAY_ON_PAGE, OF_RAY_SNOOPED = 700, 1200, 1400
"""Bytes of an image point on one machine, all in memory; on the page; and of two adjustments while data snooping."""
OF_RAY_WORKED_ON = 400
"""Bytes of an image point of the domain that is worked on: read, planned, linearised, assessed, written."""
OF_RAY_IN_DOMAIN = 1300
"""The same with what is left to borders, by which domains are made as large as fits: how wide they are shows later."""
OF_PIECE = 100e6
"""Bytes of the piece of a table, or of the rays, that is worked on."""
OF_RAY_DIVIDED = 15
"""Bytes of an image point of the whole, in the process that divides the tables: names of points and their domains."""
OF_OUTER = 8 * 6
"""Bytes of an entry of the dense matrix of outer unknowns."""
_OF_CSV_ROW = 45
"""Bytes of a row of image coordinates in a CSV file."""
_FEWEST = 2_000
"""Image points of a domain at least."""

_UNITS = {"": 1.0, "b": 1.0, "kb": 1e3, "mb": 1e6, "gb": 1e9, "tb": 1e12, "mib": 2.0**20, "gib": 2.0**30}


def size_of(text: str) -> float:
    """Bytes of an amount of memory as a person writes it: ``4GB``, ``800 MB``. Raises ``ValueError``."""
    plain = text.strip().lower().replace(" ", "")
    number = plain.rstrip("abcdefghijklmnopqrstuvwxyz")
    unit = plain[len(number) :]
    if unit not in _UNITS:
        raise ValueError(f"found {text!r}, expected an amount of memory such as 4GB or 800MB")
    try:
        size = float(number) * _UNITS[unit]
    except ValueError:
        raise ValueError(f"found {text!r}, expected an amount of memory such as 4GB or 800MB") from None
    if not 0.0 < size < 1e18:
        raise ValueError(f"found {text!r}, expected an amount of memory such as 4GB or 800MB")
    return size


def rays_of(project: Project, document: Document, folder: Path) -> int:
    """Image points in the files of a project: counted in Parquet, estimated from the size of other files."""
    total = 0
    for entry in project.observations:
        if entry.type != "image" or entry.file is None:
            continue
        frame = document.frame(entry.file)
        path = folder / entry.file
        if frame is not None:
            total += frame.height
        elif path.is_file() and path.suffix == ".parquet":
            try:
                total += pl.scan_parquet(path).select(pl.len()).collect().item()
            except pl.exceptions.PolarsError as error:
                words = f"this file cannot be read: {str(error).splitlines()[0]}"
                raise InputError([Mistake(words, str(path))]) from None
        elif path.is_file():
            total += path.stat().st_size // _OF_CSV_ROW
    return total


def need_of_all(rays: int, html: bool | None = None, snooping: bool = False) -> float:
    """Bytes that a project takes on one machine, all of it in memory; with a page where wanted, or by its size."""
    page = html if html is not None else 2 * rays <= MOST_ON_PAGE
    return PROGRAM + (OF_RAY + max(OF_RAY_ON_PAGE * page, OF_RAY_SNOOPED * snooping)) * rays


MOST_ON_PAGE = 2_000_000
"""Observations up to which there is a page where nothing else is asked for."""


def need_of_page(rays: int) -> float:
    """Bytes of the process that makes the page of domains, which shows all observations."""
    return PROGRAM + OF_RAY_ON_PAGE * rays


def has_page(rays: int, memory: float, wanted: bool | None) -> bool:
    """True where a page is wanted, or nothing else is and it is not too long; and it has room."""
    asked = wanted if wanted is not None else 2 * rays <= MOST_ON_PAGE
    return asked and need_of_page(rays) <= memory


def rays_of_domain(rays: int, memory: float, workers: int = 1) -> int:
    """Image points of a domain that fits in so much memory of a process. Raises :class:`OutOfMemoryError`."""
    dividing = _need_of_dividing(rays)
    if dividing > memory:
        words = f"dividing {rays} image points takes about {dividing / 1e9:.2f} GB in one process"
        raise OutOfMemoryError(f"{words}, and {memory / 1e9:.2f} GB are allowed (--memory)")
    fits = int((memory - PROGRAM) / OF_RAY_IN_DOMAIN)
    return max(min(fits, -(-rays // max(workers, 2))), _FEWEST)


def _need_of_dividing(rays: int) -> float:
    return PROGRAM + OF_RAY_DIVIDED * rays + 600e6 * min(rays / 2e6, 1.0)


def need_of_domains(rays: int, most: int, widest: int) -> float:
    """Bytes of a process for so many image points, ``most`` of them in the largest domain, and the widest border."""
    working = PROGRAM + OF_PIECE + OF_RAY_WORKED_ON * most + OF_OUTER * float(widest) ** 2
    return max(_need_of_dividing(rays), working)


def check_boundaries(outer: Sequence[int], root: int, memory: float) -> None:
    """Raise :class:`OutOfMemoryError` where boundaries are too wide for so much memory of a process."""
    widest = max([root, *outer])
    need = PROGRAM + OF_OUTER * float(widest) ** 2
    if need <= memory:
        return
    words = f"the widest boundary has {widest} unknowns, whose dense matrices take about {need / 1e9:.2f} GB"
    raise OutOfMemoryError(
        f"{words}, and {memory / 1e9:.2f} GB are allowed (--memory). What helps: "
        "fewer, larger domains, with more memory; without long ties across the network boundaries are narrow"
    )


def wide_borders(widest: int, rays: int) -> bool:
    """True where the dense matrices of the widest border take more room than the image points of the largest domain."""
    return OF_OUTER * float(widest) ** 2 > OF_RAY_IN_DOMAIN * float(rays)


def need_of_scratch(rays: int, results: int, stays: bool, again: bool) -> float:
    """Bytes of the scratch folder for so many image points, each with so many bytes of ``results``.

    State goes as results come, unless it ``stays`` for tests that come last. Where it is adjusted ``again`` the
    last adjustment is kept until the next one is a solution: its state is there twice.
    """
    state = _STATE_OF_RAY * (1 + again)
    return rays * float(state + results if stays or again else max(state, results + _LAST_STATE_OF_RAY))


def results_of_ray(kind: str, residuals: bool) -> int:
    """Bytes of an image point in the parts of the results, of a kind and with all residuals or the worst."""
    return _RESULTS_OF_RAY + (_RESIDUALS_OF_RAY[kind] if residuals else 0)


def check_scratch(need: float, folder: Path) -> None:
    """Raise :class:`InputError` where the file system of a folder has less room than is needed."""
    status = os.statvfs(folder) if hasattr(os, "statvfs") else None
    if status is None:
        return
    free = status.f_bavail * status.f_frsize
    if free < need:
        words = f"the state of the domains takes about {need / 1e9:.1f} GB, and {free / 1e9:.1f} GB are free there"
        raise InputError([Mistake(f"{words}; --scratch names another folder", str(folder))])


_STATE_OF_RAY = 250
"""Bytes of an image point in the scratch folder: network, plan, two iterations, and the borders."""
_LAST_STATE_OF_RAY = 50
"""The same of all domains when the last one is assessed."""
_RESULTS_OF_RAY = 45
"""Points, images and start values of the adjusted project."""
_RESIDUALS_OF_RAY = {"parquet": 250, "csv": 540}
"""Two rows of the table of residuals."""
