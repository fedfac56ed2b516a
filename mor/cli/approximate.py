"""``mor approximate``."""

from __future__ import annotations

from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING

import click

from mor.cli.console import language_option, tell, tell_note
from mor.cli.options import (
    InputPath,
    OutputPath,
    force_option,
    format_option,
    kernels_option,
    only_project,
    output_option,
    quiet_option,
)
from mor.errors import ExitCode, InputError, Message, counted, screenful

if TYPE_CHECKING:
    from mor.project.network import Network
    from mor.start.part import Approximation


@click.command(name="approximate")
@click.argument("project", type=InputPath())
@output_option("Folder for the project with start values.", "PROJECT.start")
@force_option
@format_option
@click.option(
    "--plot",
    metavar="FILE",
    type=OutputPath(),
    help="Plot a plan of the start values, coloured by part: .svg, .png or .pdf.",
)
@click.option("--json", "as_json", is_flag=True, help="Print JSON instead of text.")
@language_option("the report and the picture")
@kernels_option
@quiet_option
def command(
    project: Path,
    output: Path | None,
    force: bool,
    source_format: str | None,
    plot: Path | None,
    as_json: bool,
    lang: str,
    quiet: bool,
) -> int:
    """Compute start values for PROJECT and write a project with them.

    \b
    Examples:
      mor approximate project.yaml
      mor approximate project.yaml -o started --force
      mor approximate project.yaml --plot parts.svg --lang de
      mor approximate project.yaml --json | jq .parts

    Fixed and observed values stay as they are. Given start values are replaced if the observations contradict them.
    The report on standard output says for every value whether it was given, found or replaced, by which method, in
    which part and with which sigma, and why a value is missing. mor adjust does the same by itself.

    \b
    Exit codes: 0 done; 2 input, or values are missing and undetermined: leave_out is not set.
    """
    from mor.api.pipeline import read_document, read_network
    from mor.output_files import check_file
    from mor.quality.determinability import AT_INFINITY
    from mor.report.adjusted_project import Placed
    from mor.report.output_folder import folder_beside, reserve
    from mor.report.plots import check_picture
    from mor.report.results import PROJECT, write_project

    project = only_project(project, source_format)
    folder = output or folder_beside(project, ".start")
    document = read_document(project, source_format or "")
    if plot is not None:
        check_picture(plot)
        check_file(plot, force)
    with reserve(folder, force, [PROJECT]) as place:
        network = read_network(document, project.parent)
        approximation = _approximated(network, quiet)
        _report(network, approximation, as_json, plot, force, lang)
        missing = [thing for thing in approximation.missing if thing.treatment != AT_INFINITY]
        if missing and network.project.settings.undetermined == "refuse":
            count = counted(len(missing), "object stays", "objects stay")
            raise InputError([Message(f"{count} without start values, as the report says", str(project))])
        write_project(Placed(network, approximation.start), document, project.parent, place)
    if not quiet:
        tell(f"project with start values in {folder}")
    return ExitCode.DONE


def _approximated(network: Network, quiet: bool) -> Approximation:
    from mor.api.pipeline import worked_out
    from mor.linalg.compilation import chosen_by_size, notes_told_by
    from mor.quality.determinability import completed_or_at_infinity
    from mor.quality.test_statistics import critical_value

    for note in screenful(network.notes, "mor check --all") if not quiet else ():
        tell_note(note)
    with notes_told_by(partial(_note, quiet)), chosen_by_size(network.observations):
        found = worked_out(network)
    critical = critical_value(network.project.settings.snooping_level)
    start, missing = completed_or_at_infinity(network, found.start, found.missing, critical)
    return found._replace(start=start, missing=missing)


def _report(
    network: Network, approximation: Approximation, as_json: bool, plot: Path | None, force: bool, lang: str
) -> None:
    from mor.api.pipeline import make_problem
    from mor.report.language import words_of
    from mor.report.output_folder import to_json
    from mor.report.plots import save, style
    from mor.report.start_values import start_data, start_text, start_values

    words = words_of(lang, "start values")
    rows = start_values(network, approximation, make_problem(network, approximation.start, approximation.start))
    text = start_text(approximation, rows, words)
    click.echo(to_json(start_data(network, approximation, rows)) if as_json else text, nl=False)
    if plot is not None:
        from mor.report.start_values import parts

        with style():
            save(parts(network, approximation, words), plot, force)


def _note(quiet: bool, words: str, /, **values: object) -> None:
    if not quiet:
        tell(f"note: {words.format(**values)}")
