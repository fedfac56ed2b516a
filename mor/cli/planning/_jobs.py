"""``--jobs``: how many processes share what is to be done many times."""

from __future__ import annotations

from collections.abc import Callable
from typing import TypeVar

import click

from mor.machine import processors

F = TypeVar("F", bound=Callable[..., object])


def jobs_option(words: str) -> Callable[[F], F]:
    """The option, with what the processes do; by default as many as there are processors."""
    return click.option(
        "--jobs",
        metavar="N",
        default=processors,
        show_default="all processors",
        type=click.IntRange(min=1),
        help=words,
    )
