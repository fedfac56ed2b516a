"""The page on paper: running heads with the project, page numbers, and the browser that makes a PDF of it."""

from __future__ import annotations

import os
import re
import shutil
import subprocess
import sys
import tempfile
from pathlib import Path
from typing import Any

from markupsafe import Markup

from mor.errors import InputError, Problem
from mor.report.words.language import ENGLISH, Words

PAPERS = {"A4": "A4", "Letter": "letter"}
"""Sizes of paper by what a person calls them, as CSS has them."""
BROWSERS = (
    *("chromium", "chromium-browser", "google-chrome", "google-chrome-stable", "chrome"),
    *("microsoft-edge", "microsoft-edge-stable", "msedge"),
)
"""Programs that print a page as PDF without a window; Firefox does not."""
_APPLICATIONS = (
    "/Applications/Google Chrome.app/Contents/MacOS/Google Chrome",
    "/Applications/Chromium.app/Contents/MacOS/Chromium",
    "/Applications/Microsoft Edge.app/Contents/MacOS/Microsoft Edge",
    r"C:\Program Files\Google\Chrome\Application\chrome.exe",
    r"C:\Program Files (x86)\Microsoft\Edge\Application\msedge.exe",
)
_PATIENCE_MS = 30_000
_LONGEST = 600.0
"""Seconds a browser may take over the largest page."""


def running_heads(title: str, identity: dict[str, Any], words: Words = ENGLISH) -> Markup:
    """Style sheet of what stands above and below every printed page: project, program, date, number of the page."""
    right = " · ".join(part for part in (identity["date"], identity["program"]) if part)
    of = _css_text(words("page"))
    return Markup(
        "@page { "
        f"@top-left {{ content: {_css_text(_cut(title))}; {_SMALL} }} "
        f"@top-right {{ content: {_css_text(right)}; {_SMALL} }} "
        f'@bottom-right {{ content: {of} " " counter(page) " / " counter(pages); {_SMALL} }} '
        "}"
    )


_SMALL = 'font: 8pt system-ui, "Segoe UI", "DejaVu Sans", sans-serif; color: #444; white-space: nowrap;'
_LONGEST_HEAD = 70


def _cut(title: str) -> str:
    return title if len(title) <= _LONGEST_HEAD else f"{title[: _LONGEST_HEAD - 1]}…"


def _css_text(text: str) -> str:
    """A text of CSS that may stand in a style element: whatever has a meaning there is spelled out."""
    spelled = re.sub(r'[\x00-\x1f\\"<>&]', lambda sign: f"\\{max(ord(sign[0]), 32):x} ", text)
    return f'"{spelled}"'


def browser() -> str | None:
    """The first browser there is that prints PDF; the variable ``MOR_BROWSER`` names another."""
    given = os.environ.get("MOR_BROWSER")
    if given is not None:
        return shutil.which(given)
    return next((found for name in (*BROWSERS, *_APPLICATIONS) if (found := shutil.which(name))), None)


def print_page(program: str, page: str, target: Path, paper: str) -> None:
    """Print a page as PDF by a browser. Raises :class:`InputError` if the browser does not."""
    with tempfile.TemporaryDirectory(prefix="mor", ignore_cleanup_errors=True) as folder:
        sheet = Path(folder) / "report.html"
        size = PAPERS[paper]
        style = f"<style>@page {{ size: {size}; }} @page wide {{ size: {size} landscape; }}</style></head>"
        sheet.write_text(page.replace("</head>", style, 1), encoding="utf-8")
        made = Path(folder) / "report.pdf"
        done = _run(program, sheet, made, Path(folder) / "profile")
        if not made.is_file():
            said = done.strip().splitlines()[-1:] or ["it said nothing"]
            raise InputError([Problem(f"the browser made no PDF: {said[0]}", program)])
        shutil.move(made, target)


def _run(program: str, sheet: Path, made: Path, profile: Path) -> str:
    options = [
        *("--headless", "--disable-gpu", "--no-first-run", "--disable-extensions", "--no-pdf-header-footer"),
        "--disable-pdf-tagging",  # tags of every cell of long tables are nine tenths of the file
        f"--virtual-time-budget={_PATIENCE_MS}",
        f"--user-data-dir={profile}",
        f"--print-to-pdf={made}",
    ]
    if sys.platform != "win32" and os.geteuid() == 0:
        options.append("--no-sandbox")  # the sandbox of chromium refuses to work for root
    try:
        done = subprocess.run(
            [program, *options, sheet.as_uri()], capture_output=True, timeout=_LONGEST, check=False
        )
    except subprocess.TimeoutExpired:
        return f"it took more than {_LONGEST:g} s"
    return done.stderr.decode(errors="replace")
