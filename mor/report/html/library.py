"""The chart library the page carries: plotly.js, as the Python package ``plotly`` ships it (MIT licence)."""

from __future__ import annotations

from importlib.util import find_spec
from pathlib import Path

from mor.errors import InputError, Problem
from mor.report.html.packing import compressed


def library_path() -> Path | None:
    """Return the path of plotly.js, or ``None``; the package is not imported."""
    spec = find_spec("plotly")
    places = spec.submodule_search_locations if spec is not None else None
    for place in places or ():
        path = Path(place) / "package_data" / "plotly.min.js"
        if path.exists():
            return path
    return None


def chart_library() -> str:
    """plotly.js, compressed, as base64. Raises :class:`InputError` if it is missing."""
    path = library_path()
    if path is None:
        raise InputError([Problem("report.html needs the Python package plotly: pip install plotly")])
    return compressed(path.read_bytes())
