"""Memory of reports and tables from their sizes, before they are made; measured as that of the adjustment is."""

from __future__ import annotations

from typing import Literal

from mor.project.network.build import Network
from mor.report.results.json import INLINE

_LIBRARIES = 30e6
_ROWS_TOGETHER = 500_000
"""Rows of the long table that are in memory at a time."""
_OF_ROW = 120
_PAGE = 15e6
_OF_RAY_ON_PAGE, _OF_OTHER_ON_PAGE = 1200, 1000
"""Bytes of a row of the network beside the adjustment: in the tables, and on the page."""
_OF_POINT = 450
"""Bytes of a point in the tables and in the adjusted project."""
_OF_LISTED = 5_500
"""Bytes of a point that ``results.json`` lists, as Python objects."""
FEWER = "--no-html, and --tables worst"
"""Advice."""


def memory_of_reports(network: Network, html: bool, tables: Literal["none", "worst", "all"]) -> float:
    """Bytes that reports and tables take beside the adjusted network."""
    rays = sum(group.count for group in network.groups if len(group.type.components) == 2)
    others = sum(group.count for group in network.groups) - rays
    points = len(network.things["point"].ids)
    size = _LIBRARIES + _OF_LISTED * (points if points <= INLINE else 0)
    size += _OF_POINT * points
    if tables == "all" or html:
        size += _OF_ROW * min(rays + others, _ROWS_TOGETHER)
    if html:
        size += _PAGE + _OF_RAY_ON_PAGE * rays + _OF_OTHER_ON_PAGE * others
    return size
