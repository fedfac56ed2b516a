"""``mor approximate``."""

from __future__ import annotations

from functools import partial
from pathlib import Path

import click


@click.command(name="approximate")
@click.argument("project", type=click.Path(path_type=Path))
@click.option(
    "-o",
    "--output",
    metavar="FOLDER",
    type=click.Path(path_type=Path),
    show_default="PROJECT.start",
    help="Folder of the project with start values.",
)
@click.option("-f", "--force", is_flag=True, help="Replace files that are there already.")
@click.option("-q", "--quiet", is_flag=True, help="Say nothing but mistakes.")
def command(project: Path, output: Path | None, force: bool, quiet: bool) -> int:
    """Find start values for PROJECT and write a project that has them.

    \b
    Examples:
      mor approximate project.yaml
      mor approximate project.yaml -o started --force

    Given values stay as they are; attitudes and poses that are start values and no more are replaced where the
    observations contradict them. The protocol on standard output says how each value was obtained, what was replaced,
    or what is missing. mor adjust does the same by itself where values are missing.

    \b
    Exit codes: 0 done; 2 input, or values stay missing.
    """
    from mor.approximate.growth.strategy import approximate
    from mor.cli._compiler import compiler_announced
    from mor.compilation import chosen_by_size
    from mor.counting import counted
    from mor.errors import ExitCode, InputError, Problem
    from mor.pipeline import read_document, read_network
    from mor.report.results.adjusted.start_columns import Placed
    from mor.report.results.folder import check_inputs, folder_beside
    from mor.report.results.protocol import protocol
    from mor.report.results.reservation import check_free, reserve
    from mor.report.results.writing import PROJECT, write_project

    folder = output or folder_beside(project, ".start")
    check_free(folder, force)
    document = read_document(project)
    tables = (project.parent / name for name in document.table_files())
    check_inputs(folder, [project, *tables], [PROJECT])
    with reserve(folder, force) as place:
        network = read_network(document, project.parent)
        with compiler_announced(partial(_note, quiet)), chosen_by_size(network.observations):
            approximation = approximate(network)
        click.echo(protocol(network, approximation), nl=False)
        if approximation.missing:
            count = counted(len(approximation.missing), "thing stays", "things stay")
            raise InputError([Problem(f"{count} without start values, as the protocol says", str(project))])
        write_project(Placed(network, approximation.start), document, project.parent, place)
    if not quiet:
        click.echo(f"project with start values in {folder}", err=True)
    return ExitCode.DONE


def _note(quiet: bool, words: str, /, **values: object) -> None:
    if not quiet:
        click.echo(f"note: {words.format(**values)}", err=True)
