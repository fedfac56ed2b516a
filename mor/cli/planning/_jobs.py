"""``--jobs`` and ``--cluster``: who shares what is to be done many times."""

from __future__ import annotations

from collections.abc import Callable
from typing import TypeVar

import click

from mor.errors import InputError, Problem
from mor.machine import processors

F = TypeVar("F", bound=Callable[..., object])


def jobs_option(words: str) -> Callable[[F], F]:
    """The option, with what the processes do; by default as many as there are processors."""
    return click.option(
        "--jobs",
        metavar="N",
        default=None,
        show_default="all processors",
        type=click.IntRange(min=1),
        help=words,
    )


cluster_option = click.option(
    "--cluster",
    metavar="ADDRESS",
    help="Have it done by the workers of a Dask scheduler, e.g. tcp://host:8786 (needs mor-adjustment[dask]).",
)


def jobs_here(jobs: int | None, cluster: str | None) -> int:
    """Return the number of local processes. Raises :class:`InputError` if a cluster is given as well."""
    if jobs is not None and cluster is not None:
        raise InputError([Problem("--jobs and --cluster together; give either of them")])
    return jobs or processors()
