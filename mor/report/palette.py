"""Colours of charts: the set of Okabe and Ito, told apart by colour-blind readers, on light and on dark ground."""

from __future__ import annotations

BLUE = "#3b8fd0"
ORANGE = "#e69f00"
GREEN = "#009e73"
RED = "#d55e00"
PURPLE = "#cc79a7"
GREY = "#8a8f98"
BAND = "rgba(59,143,208,0.22)"

DIVERGING = [[0.0, "#b35806"], [0.25, "#f1a340"], [0.5, "#f7f7f7"], [0.75, "#998ec3"], [1.0, "#542788"]]
"""Brown to purple through white: signs that colour-blind readers tell apart (C. Brewer, PuOr)."""
