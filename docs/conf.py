"""The site of the documentation: ``python -m sphinx -W -b html docs site`` (see index.md)."""

from __future__ import annotations

from pathlib import Path
from typing import Any

project = "mor"
author = "the mor authors"
extensions = ["myst_parser"]
exclude_patterns = ["_build"]
nitpicky = True
highlight_language = "none"
pygments_style = "default"
pygments_dark_style = "monokai"
smartquotes = False  # 35°33'00" is what one types
myst_heading_anchors = 4

html_theme = "furo"
html_title = "mor"
html_copy_source = False
html_show_copyright = False
html_show_sphinx = False
html_show_search_summary = False  # it would be fetched, which browsers refuse for pages on the disk
html_static_path = ["site_style"]
html_css_files = ["wide.css"]

CHAPTERS = {
    "Samples": ("gallery",),
    "How to": tuple(
        f"how-to/{page}"
        for page in (
            "field-book",
            "find-a-mistake",
            "datum",
            "control-points",
            "no-start-values",
            "stereo-rig",
            "rolling-shutter",
            "underwater",
            "laboratory",
            "large-blocks",
            "batch",
            "colmap-and-metashape",
            "python",
        )
    ),
    "Tutorials": (
        "tutorials/calibration-field",
        "tutorials/facade",
        "tutorials/aerial-strip",
        "tutorials/machine-part",
        "tutorials/theodolite-network",
        "tutorials/dam",
        "tutorials/dam-epochs",
        "tutorials/rolling-shutter",
        "tutorials/planning",
    ),
    "Projects": (
        "project-file",
        "observation-types",
        "earth",
        "epochs",
        "time",
        "camera-models",
        "conventions",
        "start-values",
        "orientation",
    ),
    "Formats": (
        "formats/index",
        *(
            f"formats/{page}"
            for page in (
                "colmap",
                "opensfm",
                "alicevision",
                "metashape",
                "photomodeler",
                "dbat",
                "pix4d",
                "bal",
                "aicon",
            )
        ),
        *(
            f"formats/{page}"
            for page in (
                "gkf",
                "textbook",
                "starnet",
                "jag3d",
                "comp3d",
                "dynadjust",
                "snap",
                "sinex",
                "field-books",
                "drawings",
            )
        ),
    ),
    "Before the measurement": ("planning",),
    "Results": ("reports", "results", "statistics", "reliability"),
    "Scripts and developers": (
        "python",
        "commands",
        "exit-codes",
        "architecture",
        "adding-an-observation-type",
        "how-to/add-a-format",
        "benchmarks",
    ),
}
"""The pages in the order of reading, as index.md has them."""


def add_contents(_: Any, page: str, source: list[str]) -> None:
    """Give the first page the contents of the side bar; kept out of the text, which is read as a file, too."""
    if page == "index":
        placed = {name for pages in CHAPTERS.values() for name in pages}
        others = sorted({path.stem for path in Path(__file__).parent.glob("*.md")} - placed - {"index"})
        for caption, pages in {**CHAPTERS, "Further": others}.items():
            lines = "\n".join(pages)
            source[0] += f"\n```{{toctree}}\n:hidden:\n:caption: {caption}\n\n{lines}\n```\n"


def setup(app: Any) -> None:
    """Called by Sphinx."""
    app.connect("source-read", add_contents)
