"""``mor report``."""

from __future__ import annotations

from pathlib import Path

import click

from mor.cli.console import language_option
from mor.cli.options import InputPath, output_option
from mor.errors import InputError, Message


@click.command(name="report")
@click.argument("results", type=InputPath())
@click.option("--pdf", is_flag=True, help="Print the report as PDF.")
@click.option(
    "--paper", type=click.Choice(["A4", "Letter"]), default="A4", show_default=True, help="Paper size of the PDF."
)
@output_option(
    "File to write. A protocol ends in .txt, .html or .json.",
    "report.pdf, report.html or protocol.txt in RESULTS",
    metavar="FILE",
)
@click.option("-f", "--force", is_flag=True, help="Replace an existing file.")
@click.option(
    "--appendix",
    metavar="NAMES",
    help="Add appendices to the PDF: residuals, images, covariances (separated by commas).",
)
@click.option(
    "--protocol",
    type=click.Choice(["iso17123-3", "iso17123-4", "iso17123-5", "iso17123-8", "vdi2634-1"]),
    help="Write the protocol of a test by this standard.",
)
@click.option(
    "--against",
    metavar="RESULTS",
    type=InputPath(),
    help="Other test to compare the standard deviation with, for --protocol.",
)
@click.option(
    "--permissible",
    nargs=2,
    type=click.FloatRange(min=0.0),
    metavar="A K",
    help="Permissible length measurement error A + K·L of vdi2634-1: A in mm, K in mm per m.",
)
@language_option("the PDF or the page")
def command(
    results: Path,
    pdf: bool,
    paper: str,
    output: Path | None,
    force: bool,
    appendix: str | None,
    protocol: str | None,
    against: Path | None,
    permissible: tuple[float, float] | None,
    lang: str,
) -> None:
    """Print the report in RESULTS as PDF, or write report.html in another language.

    \b
    Examples:
      mor report project.results --pdf
      mor report project.results --pdf --paper Letter -o signed.pdf
      mor report project.results --appendix residuals,images
      mor report project.results --lang de -o bericht.html
      mor report line.results --protocol iso17123-4 --against last_year.results

    RESULTS is a folder of results. The PDF is a short report to sign; it needs the extra plot
    (pip install 'mor-adjustment[plot]').

    \b
    Exit codes: 0 done; 2 input.
    """
    from mor.input_files import note_input
    from mor.output_files import check_file, listed_files, write_file
    from mor.report.language import words_of
    from mor.report.view import view_of_folder

    pdf = pdf or appendix is not None
    name = "report.pdf" if pdf else "report.html" if protocol is None else "protocol.txt"
    if (pdf and protocol is not None) or (against is not None and protocol is None):
        raise InputError([Message("--protocol goes without --pdf, and --against with --protocol")])
    target = output or results / name
    if protocol is not None and target.suffix.lower() not in (".txt", ".html", ".json"):
        raise InputError([Message("expected a name that ends in .txt, .html or .json", str(target))])
    if not (results / "results.json").is_file():
        raise InputError([Message("there is no results.json in this folder", str(results))])
    listed = listed_files(results)
    for file in listed:
        if file != name:
            note_input(results / file)  # a report replaces no other file of the results
    force = force or (output is None and name in listed)
    check_file(target, force)
    view, words = view_of_folder(results), words_of(lang, "page")
    if protocol is not None:
        from mor.report.output_folder import to_json
        from mor.report.protocol import protocol as protocol_of
        from mor.report.protocol import protocol_page, protocol_text

        data = protocol_of(view, protocol, None if against is None else view_of_folder(against), permissible)
        writers = {".txt": protocol_text, ".html": protocol_page}
        write = writers.get(target.suffix.lower())
        write_file(target, to_json(data) if write is None else write(data, words_of(lang)), force)
    elif pdf:
        from mor.report.paper import report_on_paper

        names = [part.strip() for part in (appendix or "").split(",") if part.strip()]
        write_file(target, report_on_paper(view, results, names, paper, words).write, force)
    else:
        from mor.report.page import page

        write_file(target, page(view, words), force)
    click.echo(str(target), err=True)
