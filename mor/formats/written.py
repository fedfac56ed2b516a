"""Files produced by a writer, and notes on content that they cannot hold."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path
from typing import NamedTuple

from mor.errors import Problem
from mor.project.file.nodes import Document


class Written(NamedTuple):
    """Contents by path, and what was left out of them."""

    files: dict[Path, bytes]
    notes: list[Problem]


Writer = Callable[[Document, Path, Path], Written]
"""Document, the folder its tables are found from, target."""
