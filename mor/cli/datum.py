"""``mor datum``."""

from __future__ import annotations

from pathlib import Path

import click

from mor.cli.console import language_option
from mor.cli.options import InputPath, output_option


@click.command(name="datum")
@click.argument("results", type=InputPath())
@click.option("--to", "target", metavar="DATUM", required=True, help="The other datum, as in the project file.")
@output_option("Folder for all results in that datum; by default the points are printed as CSV.")
@click.option("-f", "--force", is_flag=True, help="Replace existing results.")
@language_option("report.txt and report.html")
def command(results: Path, target: str, output: Path | None, force: bool, lang: str) -> None:
    """Transform RESULTS to another datum by an S-transformation, without a new adjustment.

    \b
    Examples:
      mor datum project.results --to free
      mor datum project.results --to "free: [1, 2, 7]" -o inner
      mor datum project.results --to "free: {xy: [1, 2], z: [5]}"
      mor datum project.results --to "minimal: {xyz: 1, xy: 2, z: 5}"

    RESULTS is a folder of results, or a project. Residuals and redundancy stay as they are; coordinates and their
    covariances change. Fixed coordinates may belong to the datum if they do not constrain the network.

    \b
    Exit codes: 0 done; 2 input, or no solution.
    """
    from mor.api.result import in_datum, reopen
    from mor.output_files import check_folder
    from mor.report.estimates import point_table
    from mor.report.identity import RunIdentity
    from mor.report.language import words_of
    from mor.report.output_folder import reserve
    from mor.report.results import Choice, tables_by_size, usual_files, write_results

    project = reopen(results)
    if output is not None:
        check_folder(output, force, usual_files(None, "csv"))
    project, solved = in_datum(project, target, "--to")
    if not solved.adjustment.defect.datum.size:
        words = "the observations define the datum themselves (defect 0): it stays the same whatever --to says"
        click.echo(words_of(lang)("note: {text}", text=words_of(lang)(words)), err=True)
    if output is not None:
        choice = Choice(tables_by_size(solved), language=lang)
        with reserve(output, force) as place:
            of = RunIdentity(project.files, project.folder, ("--to", target))
            write_results(solved, project.document, of, place, choice)
        click.echo(words_of(lang)("results in {place}", place=output), err=True)
    else:
        from mor.project.document import csv_lines

        click.echo(bytes(csv_lines(point_table(solved))).decode(), nl=False)
