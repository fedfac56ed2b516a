"""``mor design``."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING

import click

from mor.cli.console import language_option
from mor.cli.options import (
    InputPath,
    force_option,
    format_option,
    kernels_option,
    only_project,
    output_option,
    quiet_option,
)
from mor.errors import ExitCode, screenful

if TYPE_CHECKING:
    from mor.api.design import Design


@click.command(name="design")
@click.argument("project", type=InputPath())
@output_option("Folder for the plan.", "PROJECT.design")
@force_option
@format_option
@click.option("--rank", is_flag=True, help="Rank planned observations and candidates by their contribution.")
@click.option(
    "--greedy",
    metavar="N",
    type=click.IntRange(min=1),
    help="Choose up to N candidates, one after another, until all requirements are met.",
)
@click.option("--json", "as_json", is_flag=True, help="Print design.json on standard output; write files only with -o.")
@language_option("the report")
@kernels_option
@quiet_option
def command(
    project: Path,
    output: Path | None,
    force: bool,
    source_format: str | None,
    rank: bool,
    greedy: int | None,
    as_json: bool,
    lang: str,
    quiet: bool,
) -> int:
    """Predict precision and reliability of PROJECT before it is measured.

    \b
    Examples:
      mor design project.yaml
      mor design project.yaml --rank --greedy 20
      mor design project.yaml --json --quiet | jq .fulfilled
      mor design project.results/adjusted.yaml -o plan_of_next_epoch

    The plan has expected sigmas, redundancy numbers, detectable errors and weak directions, computed at the start
    values. Measured values are not needed and are ignored. The project file lists requirements under require, what-if
    variants under variants, and possible additional observations under candidates.

    \b
    Exit codes: 0 done, all requirements are met; 1 a requirement is not met; 2 input;
    4 singular: the plan leaves something undetermined.
    """
    from mor.api.design import designed
    from mor.input_files import files_read
    from mor.output_files import check_folder
    from mor.report.design import USUAL_FILES
    from mor.report.identity import RunIdentity
    from mor.report.output_folder import folder_beside, reserve

    project = only_project(project, source_format)
    writes = output is not None or not as_json
    folder = output or folder_beside(project, ".design")
    if writes:
        check_folder(folder, force, USUAL_FILES)
    with files_read() as files:
        design = designed(project, source_format or "", rank or greedy is not None, greedy or 0)
    of = RunIdentity(tuple(files.values()), project.parent, _options(rank, greedy, source_format))
    if writes:
        with reserve(folder, force, USUAL_FILES) as place:
            design.write(place, of, lang)
    if as_json:
        click.echo(design.json(of), nl=False)
    if not quiet:
        _tell(design, lang, folder if writes else None)
    if design.solved.quality is None:
        return ExitCode.SINGULAR
    return ExitCode.DONE if design.fulfilled else ExitCode.REJECTED


def _options(rank: bool, greedy: int | None, source_format: str | None) -> tuple[str, ...]:
    options = (*(("--rank",) if rank else ()), *(("--greedy", str(greedy)) if greedy else ()))
    return (*options, *(("--from", source_format) if source_format else ()))


def _tell(design: Design, lang: str, folder: Path | None) -> None:
    from mor.report.language import words_of

    words = words_of(lang, "planning")
    for note in screenful(design.notes, "mor check --all"):
        click.echo(words("note: {text}", text=note._replace(message=words.told(note.message))), err=True)
    click.echo(design.screen(words), err=True)
    if folder is not None:
        click.echo(words("plan in {place}", place=folder), err=True)
