"""All results of an adjustment, as files."""

from __future__ import annotations

from pathlib import Path

import polars as pl

from mor.project.nodes import Document
from mor.quality.solved import Solved
from mor.report.adjusted_project import Placed, adjusted_project
from mor.report.folder import Writer, write_folder
from mor.report.json import results, to_json
from mor.report.observation_table import observation_table
from mor.report.tables import image_table, point_table, reference_table
from mor.report.text import text_report
from mor.report.words.language import words_of

TABLES = {"residuals": "residuals.csv", "points": "points.csv", "images": "images.csv"}


def write_results(
    solved: Solved,
    document: Document,
    source: Path,
    folder: Path,
    force: bool,
    html: bool = True,
    language: str = "en",
) -> None:
    """Write report and ``results.json`` into a folder, and where it converged tables and the adjusted project.

    The text report is written in ``language`` (en, de). With ``html``, also the page for people, ``report.html``.
    """
    residuals = observation_table(solved)
    converged = solved.quality is not None
    writers: dict[str, Writer] = {
        "results.json": _text(to_json(results(solved, residuals, TABLES if converged else {}))),
        "report.txt": _text(text_report(solved, residuals, words_of(language))),
    }
    if converged:
        text, starts = adjusted_project(_placed(solved), document, source.resolve(), folder.resolve())
        frames = {
            "residuals.csv": residuals,
            "points.csv": point_table(solved),
            "images.csv": image_table(solved),
            "reference.csv": reference_table(solved),
            **starts,
        }
        writers |= {name: _csv(frame) for name, frame in frames.items()}
        writers["adjusted.yaml"] = _text(text)
        if html:
            writers["report.html"] = _text(_page(solved, residuals))
    write_folder(folder, writers, force)


def _placed(solved: Solved) -> Placed:
    snooped = solved.treatment is not None and solved.treatment.snooping is not None
    return Placed(solved.network, solved.adjustment.values, snooped)


def write_project(placed: Placed, document: Document, source: Path, folder: Path, force: bool) -> None:
    """Write a project with the placed values as start values, and its tables, into a folder."""
    text, starts = adjusted_project(placed, document, source.resolve(), folder.resolve())
    writers: dict[str, Writer] = {name: _csv(frame) for name, frame in starts.items()}
    write_folder(folder, {**writers, "project.yaml": _text(text)}, force)


def results_text(solved: Solved) -> str:
    """``results.json`` as text, for programs that read standard output."""
    return to_json(results(solved, observation_table(solved), {}))


def _page(solved: Solved, residuals: pl.DataFrame) -> str:
    from mor.report.html.page import page
    from mor.report.view import view_of

    return page(view_of(solved, residuals))


def _text(text: str) -> Writer:
    def write(path: Path) -> None:
        path.write_text(text, encoding="utf-8")

    return write


def _csv(frame: pl.DataFrame) -> Writer:
    def write(path: Path) -> None:
        frame.write_csv(path)

    return write
