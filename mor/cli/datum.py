"""``mor datum``."""

from __future__ import annotations

from pathlib import Path

import click


@click.command(name="datum")
@click.argument("results", type=click.Path(path_type=Path))
@click.option("--to", "target", required=True, help="The other datum, as the project file writes it.")
@click.option("-o", "--output", type=click.Path(path_type=Path), help="Folder for all results in that datum.")
@click.option("-f", "--force", is_flag=True, help="Replace results that are there already.")
def command(results: Path, target: str, output: Path | None, force: bool) -> None:
    """Carry RESULTS (a folder, or a project) into another datum by S-transformation.

    Residuals and redundancy stay as they are; coordinates and their covariances change. Without -o the points are
    printed as CSV. Coordinates held fixed may take part where they do not strain the network.

    \b
    Examples:
      mor datum project.results --to free
      mor datum project.results --to "free: [1, 2, 7]" -o inner
      mor datum project.results --to "free: {xy: [1, 2], z: [5]}"
      mor datum project.results --to "minimal: {xyz: 1, xy: 2, z: 5}"
    """
    from mor.cli._results import in_datum, inputs, open_results
    from mor.report.folder import check_free, check_inputs
    from mor.report.tables import point_table
    from mor.report.write import Choice, tables_by_size, write_results

    if output is not None:
        check_free(output, force)
    opened = open_results(results)
    if output is not None:
        check_inputs(output, inputs(opened))
    solved, document = in_datum(opened, target)
    if output is not None:
        write_results(solved, document, opened.folder, output, force, Choice(tables_by_size(solved)))
        click.echo(f"results in {output}", err=True)
    else:
        click.echo(point_table(solved).write_csv(), nl=False)
