"""From a project to its result."""

from __future__ import annotations

from collections.abc import Callable
from typing import TYPE_CHECKING

from mor.api.project import Project, Source, read
from mor.api.result import Result

if TYPE_CHECKING:
    from mor.adjustment.state import Watcher
    from mor.quality.effort import Done


def adjust(
    source: Source | Project,
    snoop: bool = False,
    watch: Watcher | None = None,
    assessing: Callable[[int], Done] | None = None,
) -> Result:
    """Adjust a project and assess the outcome; start values that are missing are worked out.

    Args:
        source: a :class:`Project`, or what :func:`read` takes.
        snoop: take flagged observations out one by one until the rest is clean (data snooping).
        watch: called after every iteration.
        assessing: called between the solution and its statistics with the effort ahead; what it returns is told how
            much more is done.

    Raises:
        InputError: the project has mistakes, or start values cannot be found. That an adjustment does not converge, or
            that the network is singular, is no error: the result says so.
    """
    from mor.pipeline import snooped, solve_network

    project = source if isinstance(source, Project) else read(source)
    network = snooped(project.network) if snoop else project.network
    return Result(project, solve_network(network, watch, assessing))
