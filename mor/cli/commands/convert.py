"""``mor convert``."""

from __future__ import annotations

from pathlib import Path

import click


@click.command(name="convert")
@click.argument("foreign", type=click.Path(path_type=Path))
@click.option(
    "-o",
    "--output",
    metavar="FILE",
    type=click.Path(path_type=Path),
    required=True,
    help="Project file to write (.yaml); its tables are written beside it.",
)
@click.option("-f", "--force", is_flag=True, help="Replace files that are there already.")
@click.option("-q", "--quiet", is_flag=True, help="Say nothing but mistakes.")
def command(foreign: Path, output: Path, force: bool, quiet: bool) -> None:
    """Write the project that a FOREIGN file or folder describes as a project file.

    \b
    Examples:
      mor convert network.gkf -o network.yaml
      mor convert aicon/project -o project.yaml
      mor convert network.gkf -o network.yaml && mor adjust network.yaml

    Known: .gkf (GNU Gama), .dat (Krumm), .ior .eor .obc .phc .scale (AICON), .txt (PhotoModeler). What a reader leaves
    out is noted. mor adjust and mor check read these files directly, too.

    \b
    Exit codes: 0 done; 2 input.
    """
    from mor.counting import counted
    from mor.formats import read_foreign
    from mor.project.file.writing import project_files

    document = read_foreign(foreign)
    texts = project_files(document.data, foreign.parent, output)
    write_new(texts, force)
    if not quiet:
        for note in document.notes:
            click.echo(f"note: {note}", err=True)
        click.echo(
            f"{output}, and {counted(len(texts) - 1, 'table')} beside it" if len(texts) > 1 else str(output),
            err=True,
        )


def write_new(texts: dict[Path, str], force: bool) -> None:
    """Write texts. Raises :class:`mor.errors.InputError` before anything is written if a file is there already."""
    from mor.errors import InputError, Problem

    there = [path for path in texts if path.exists()]
    if there and not force:
        raise InputError([Problem("this file exists; --force replaces it", str(path)) for path in there])
    for path, text in texts.items():
        path.parent.mkdir(parents=True, exist_ok=True)
        path.write_text(text, encoding="utf-8")
