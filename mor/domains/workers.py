"""Domains by the workers of a cluster.

Everything longer than a boundary is in files that all processes see, written beside their place first, so that a task
may be done twice and leaves the same bytes.
"""

from __future__ import annotations

import sys
from collections.abc import Callable
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from mor.adjustment.domains.store import FileStore
from mor.cluster import Cluster
from mor.compilation import chosen_by_size
from mor.machine import keep_freed_memory
from mor.sparse.blas_threads import one_thread


@dataclass
class Workers:
    """Tasks of domains, done by a cluster."""

    store: FileStore
    cluster: Cluster
    observations: int
    """Of the whole project: what decides whether kernels are compiled."""

    @property
    def ahead(self) -> int:
        """All: the scheduler has them wait."""
        return sys.maxsize

    def submit(self, task: Callable[..., Any], *arguments: Any) -> Any:
        """Have a worker do the task."""
        return self.cluster.submit(_done, task, self.store, self.observations, *arguments)

    def layer(self, name: str) -> Workers:
        """The same with a layer of the store."""
        return replace(self, store=self.store.layer(name))

    def result(self, submitted: Any) -> Any:
        """What the task has returned. Raises :class:`InputError` where nobody does it any more."""
        return self.cluster.result(submitted)


def _done(task: Callable[..., Any], store: FileStore, observations: int, *arguments: Any) -> Any:
    keep_freed_memory()
    with chosen_by_size(observations), one_thread(), np.errstate(all="ignore"):
        return task(store, *arguments)
