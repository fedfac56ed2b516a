"""``mor diagnose``."""

from __future__ import annotations

import json
import time
from pathlib import Path
from typing import TYPE_CHECKING

import click

from mor.cli.console import language_option
from mor.cli.options import InputPath, format_option, kernels_option, only_project, quiet_option
from mor.errors import ExitCode

if TYPE_CHECKING:
    from mor.diagnose.hypothesis import Hypothesis


@click.command(name="diagnose")
@click.argument("project", type=InputPath())
@click.option(
    "--limit",
    metavar="SECONDS",
    type=click.FloatRange(min=0.0),
    default=60.0,
    show_default=True,
    help="Time limit for all trials, checked after each.",
)
@format_option
@click.option("--json", "as_json", is_flag=True, help="Print the result as JSON on standard output.")
@click.option("--table", is_flag=True, help="Print all hypotheses that were tried.")
@language_option("the output")
@kernels_option
@quiet_option
def command(
    project: Path, limit: float, source_format: str | None, as_json: bool, table: bool, lang: str, quiet: bool
) -> int:
    """Search for mistakes in PROJECT by adjusting it under one hypothesis after another.

    \b
    Examples:
      mor diagnose project.yaml
      mor diagnose project.yaml --limit 300 --table
      mor diagnose network.gkf --json | jq '.offered[0]'

    Hypotheses are mistakes that people make: exchanged names, a forgotten height, a wrong unit, a circle that counts
    the other way. Each is tried in an adjustment of its own. No file is written and no hypothesis is applied. If a
    change of the project file expresses the hypothesis, it is printed as a diff.

    \b
    Exit codes: 0 nothing is rejected; 1 something is rejected, explained or not; 2 input.
    """
    from mor.api.pipeline import diagnose_network, read_document, read_network
    from mor.api.project import Project
    from mor.cli.progress import progress
    from mor.report.language import words_of
    from mor.report.observations import diagnosis, possible_causes
    from mor.report.text_findings import diagnosed, scored, tried

    project, words = only_project(project, source_format), words_of(lang)
    with progress(quiet, False, None, words) as say:
        say.phase("reading")
        document = read_document(project, source_format or "")
        network = read_network(document, project.parent)
        begun: list[float] = []

        def go_on(hypothesis: Hypothesis) -> bool:
            begun.append(time.monotonic())
            left = limit - (begun[-1] - begun[0])
            if left > 0.0:
                say.phase(f"{words.listed(hypothesis.cause)} ({', '.join(hypothesis.things)})")
            return left > 0.0

        say.phase("adjusting")
        solved, found = diagnose_network(Project(document, network, project.parent).network, go_on, say.iteration)
    data = diagnosis(network, found, document, project.parent)
    data["possible_causes"] = possible_causes(solved) if solved is not None else []
    accepted = solved is not None and solved.accepted and solved.suspects is None and not found.trials
    if as_json:
        click.echo(json.dumps({"accepted": accepted, **data}, ensure_ascii=False, indent=1, allow_nan=False))
    elif accepted:
        click.echo(words("Nothing is rejected; no hypothesis was tried."))
    else:
        click.echo(diagnosed(data, words))
        if data["possible_causes"]:
            click.echo("\n" + scored(data["possible_causes"], words))
        if table and data["tried"]:
            click.echo("\n" + tried(data, words))
    return ExitCode.DONE if accepted else ExitCode.REJECTED
