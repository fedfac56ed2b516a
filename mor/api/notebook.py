"""Show a result in a notebook: its summary as text, and the network as a drawing."""

from __future__ import annotations

from html import escape
from io import StringIO

from mor.quality.solution import Solved


def summary_and_network(solved: Solved) -> str:
    """HTML of the summary of one screen; below it the network in plan where there is a solution and matplotlib."""
    from mor.report.text import screen

    return f"<pre>{escape(screen(solved))}</pre>{_network(solved)}"


def _network(solved: Solved) -> str:
    try:
        import matplotlib  # noqa: F401 - an extra: without it there is no drawing
    except ImportError:
        return ""
    if solved.quality is None:
        return ""
    from mor.report.observations import SHOWN, observation_table
    from mor.report.plots import network, style
    from mor.report.view import view_of

    text = StringIO()
    with style():
        network(view_of(solved, observation_table(solved, SHOWN))).savefig(text, format="svg")
    drawing = text.getvalue()
    return drawing[drawing.index("<svg") :]
