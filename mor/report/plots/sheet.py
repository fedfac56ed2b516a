"""A sheet to draw on, and how it becomes a file: same picture, same bytes."""

from __future__ import annotations

import warnings
from contextlib import AbstractContextManager
from pathlib import Path
from typing import TYPE_CHECKING, Any, cast

from mor.errors import InputError, Problem
from mor.escapes import escaped, shortened
from mor.output_files import write_file

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

FORMATS = ("svg", "png", "pdf")
_STYLE: dict[str, Any] = {
    "svg.hashsalt": "mor",
    "font.family": "DejaVu Sans",
    "font.size": 9.0,
    "text.parse_math": False,
    "axes.grid": True,
    "axes.axisbelow": True,
    "grid.color": "#dddddd",
    "grid.linewidth": 0.6,
    "axes.spines.top": False,
    "axes.spines.right": False,
    "legend.frameon": False,
    "savefig.dpi": 150,
}
_LONGEST = 100
"""Letters of a line of text: what a sheet is wide enough for."""
_NO_DATE: dict[str, dict[str, Any]] = {
    "svg": {"Date": None, "Creator": "mor"},
    "pdf": {"CreationDate": None, "ModDate": None, "Creator": "mor", "Producer": "mor"},
    "png": {"Software": "mor"},
}


def style() -> AbstractContextManager[None]:
    """The look of pictures, to draw and save them in. Raises :class:`InputError` if matplotlib is missing."""
    try:
        from matplotlib import rc_context
    except ImportError:
        words = "pictures need the Python package matplotlib: pip install 'mor-adjustment[plot]'"
        raise InputError([Problem(words)]) from None
    return rc_context(cast("Any", _STYLE))


def sheet(width: float = 7.5, height: float = 5.0) -> Figure:
    """An empty figure, inches."""
    from matplotlib.figure import Figure

    return Figure(figsize=(width, height), layout="constrained")


def scale_bar(axes: Axes, length: float, words: str) -> None:
    """A bar of a length in data units below the lower left corner, with its words."""
    from matplotlib.transforms import blended_transform_factory

    left = min(axes.get_xlim())
    place = blended_transform_factory(axes.transData, axes.transAxes)
    start = max(axes.get_xlim()) if axes.xaxis_inverted() else left
    step = -length if axes.xaxis_inverted() else length
    axes.plot([start, start + step], [1.03, 1.03], transform=place, color="black", lw=2.5, clip_on=False)
    axes.annotate(
        words, (start + step, 1.03), (5, 0), xycoords=place, textcoords="offset points", va="center"
    )


def check_picture(path: Path) -> None:
    """Raise :class:`InputError` for a file whose suffix is that of no picture."""
    if path.suffix.lower().removeprefix(".") not in FORMATS:
        words = f"unknown format {path.suffix!r} of a picture (known: {', '.join('.' + f for f in FORMATS)})"
        raise InputError([Problem(words, str(path))])


def save(figure: Figure, path: Path, force: bool) -> None:
    """Write a figure; its suffix says how. Raises :class:`InputError` for a suffix that is not known."""
    check_picture(path)
    spell_out(figure)
    write_file(path, lambda place: _draw(figure, place), force)


def _draw(figure: Figure, path: Path) -> None:
    suffix = path.suffix.lower().removeprefix(".")
    with warnings.catch_warnings():
        # Scripts that the font lacks are drawn as boxes, which can be seen in the picture.
        warnings.filterwarnings("ignore", message="Glyph")
        figure.savefig(path, format=suffix, metadata=_NO_DATE[suffix])


def spell_out(figure: Figure) -> None:
    """Names with control characters, which no picture may contain as they are, or longer than a sheet is wide."""
    from matplotlib.text import Text

    for text in cast("list[Text]", figure.findobj(Text)):
        lines = escaped(text.get_text()).split("\n")
        text.set_text("\n".join(shortened(line, _LONGEST) for line in lines))
