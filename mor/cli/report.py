"""``mor report``."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING

import click

from mor.cli.console import language_option, tell
from mor.cli.options import InputPath, OutputPath

if TYPE_CHECKING:
    from mor.output_files import Writer
    from mor.report.language import Words


@click.command(name="report")
@click.argument("results", type=InputPath())
@click.option("--pdf", is_flag=True, help="Print the report as PDF.")
@click.option(
    "--paper",
    type=click.Choice(["A4", "Letter"]),
    default="A4",
    show_default=True,
    help="Paper of the PDF.",
)
@click.option(
    "-o",
    "--output",
    metavar="FILE",
    type=OutputPath(),
    show_default="report.pdf or report.html in RESULTS",
    help="The file that is written.",
)
@click.option("-f", "--force", is_flag=True, help="Replace a file that is there already.")
@language_option("the page; a PDF has that of the report it is made of")
def command(results: Path, pdf: bool, paper: str, output: Path | None, force: bool, lang: str) -> None:
    """Print the report in RESULTS as PDF, or write its page anew in another language.

    \b
    Examples:
      mor report project.results --pdf
      mor report project.results --pdf --paper Letter -o signed.pdf
      mor report project.results --lang de -o bericht.html

    RESULTS is a folder of results. The PDF is printed by the first browser that is found (Chromium, Chrome, Edge;
    MOR_BROWSER names another); without one it has the text of report.txt, for which matplotlib is needed.

    \b
    Exit codes: 0 done; 2 input.
    """
    from mor.errors import InputError
    from mor.errors import Message as Problem
    from mor.output_files import check_file, listed_files, write_file

    name = "report.pdf" if pdf else "report.html"
    target = output or results / name
    if not (results / "results.json").is_file():
        raise InputError([Problem("there is no results.json in this folder", str(results))])
    force = force or (output is None and name in listed_files(results))
    check_file(target, force)
    write_file(target, _printed(results, paper) if pdf else _page(results, lang), force)
    click.echo(str(target), err=True)


def _printed(results: Path, paper: str) -> Writer:
    """What writes the PDF: of the page where a browser is found, of the text otherwise."""
    from mor.errors import InputError
    from mor.errors import Message as Problem
    from mor.input_files import TABLE, read_text
    from mor.report.page import browser, print_page

    page, program = results / "report.html", browser()
    if program is not None and page.is_file():
        content = read_text(page, TABLE)
        return lambda path: print_page(program, content, path, paper)
    text = results / "report.txt"
    if not text.is_file():
        raise InputError(
            [Problem("there is neither report.html nor report.txt in this folder", str(results))]
        )
    why = "there is no report.html" if program is not None else "no browser was found"
    tell(f"note: {why}: the PDF has the text of report.txt, without pictures")
    return _text_printed(text, paper)


def _text_printed(text: Path, paper: str) -> Writer:
    from mor.input_files import TABLE, read_text
    from mor.report.language import words_of_page
    from mor.report.plots import write_text_pages

    said = read_text(text, TABLE)
    words = words_of_page(_language(said))
    return lambda path: write_text_pages(said, said.split("\n", 1)[0], path, paper, words)


def _language(report: str) -> str:
    """Language of a text report, by the heading of its last section."""
    from mor.report.language import LANGUAGES, words_of

    title = "About this report"
    return next((name for name in LANGUAGES if f"\n{words_of(name)(title)}\n" in report), LANGUAGES[0])


def _page(results: Path, lang: str) -> str:
    from mor.report.language import words_of_page
    from mor.report.page import page
    from mor.report.view import view_of_folder

    words: Words = words_of_page(lang)
    return page(view_of_folder(results), words)
