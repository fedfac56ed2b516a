"""``mor convert``."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING

import click

from mor.cli.console import tell, tell_note
from mor.cli.options import OutputPath, force_option, quiet_option
from mor.errors import InputError, Message, counted

if TYPE_CHECKING:
    from mor.project.document import Document

_OWN = (".yaml", ".yml")


@click.command(name="convert")
@click.argument("paths", metavar="SOURCE... TARGET", nargs=-1, type=OutputPath())
@click.option("-o", "--output", metavar="FILE", type=OutputPath(), help="The same as TARGET.")
@click.option(
    "--from",
    "source_formats",
    metavar="FORMAT",
    multiple=True,
    help="Format of SOURCE; by default found from its content. Repeat it for several files, in their order.",
)
@click.option("--to", "target_format", metavar="FORMAT", help="Format of TARGET, if its suffix does not determine it.")
@force_option
@quiet_option
def command(
    paths: tuple[Path, ...],
    output: Path | None,
    source_formats: tuple[str, ...],
    target_format: str | None,
    force: bool,
    quiet: bool,
) -> None:
    """Convert SOURCE, a file or folder of another program, to a project file, or a project to another format.

    \b
    Examples:
      mor convert network.gkf network.yaml
      mor convert aicon/project -o project.yaml
      mor convert sparse/0 block.yaml && mor adjust block.yaml
      mor convert block.results/adjusted.yaml model --to colmap
      mor convert sparse/0 markers.csv block.yaml

    mor recognises the format of SOURCE by its content. TARGET is a project file (.yaml), with long tables beside it,
    or a file in the format of its suffix or of --to. Notes list what was not read, and what TARGET cannot hold.
    Several files become one project: points and images of the same name are the same, and fixed or observed values
    take precedence over start values. mor adjust and mor check also read files of other programs directly. The manual
    has a page for each format.

    \b
    Exit codes: 0 done; 2 input.
    """
    from mor.formats import format_to_write, write_foreign
    from mor.input_files import note_input
    from mor.output_files import write_files
    from mor.project.document import project_files

    sources, place = (paths, output) if output is not None else (paths[:-1], paths[-1] if paths else None)
    if place is None or not sources:
        raise InputError([Message("give a SOURCE, and one TARGET, the file or folder to write")])
    for source in sources:
        note_input(source)
    source = sources[0]
    key = target_format or ("" if place.suffix.lower() in _OWN else format_to_write(place))
    document = _read(sources, source_formats, bool(key))
    if not key and place.suffix.lower() not in _OWN:
        words = "this name has no suffix of a known format; use the suffix .yaml for a project file, or --to FORMAT"
        raise InputError([Message(words, str(place))])
    if key:
        files, notes = write_foreign(document, source.parent, place, key)
        said = f"{place}: {counted(len(files), 'file')}, {key}"
    else:
        texts = project_files(document.data, source.parent, place, document.frames)
        files, notes = {path: text.encode() for path, text in texts.items()}, []
        said = f"{place}, and {counted(len(files) - 1, 'table')} beside it" if len(files) > 1 else str(place)
    write_files(files, force, makes_folders=True)
    if not quiet:
        for note in [*document.notes, *notes]:
            tell_note(note)
        tell(said)


def _read(sources: Sequence[Path], formats: Sequence[str], written_as_foreign: bool) -> Document:
    from mor.api.pipeline import read_document
    from mor.formats import read_foreign, read_together

    if len(sources) > 1:
        return read_together(sources, formats)
    source, form = sources[0], formats[0] if formats else ""
    plain = source.suffix.lower() in _OWN and not form and written_as_foreign
    return read_document(source) if plain else read_foreign(source, form)
