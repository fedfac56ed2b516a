"""``mor examples``."""

from __future__ import annotations

from pathlib import Path

import click

from mor.cli.console import tell
from mor.cli.options import output_option
from mor.errors import InputError, Message, nearest


@click.command(name="examples")
@click.argument("name", required=False)
@output_option("Folder for the copy; it must be new or empty.", "NAME")
def command(name: str | None, output: Path | None) -> None:
    """List the sample projects, or copy the one named NAME.

    \b
    Examples:
      mor examples
      mor examples facade && mor adjust facade/project.yaml
      mor examples building -o my_first_project

    \b
    Exit codes: 0 done; 2 input.
    """
    if name is None:
        width = max(len(folder.name) for folder in sample_projects())
        for folder in sample_projects():
            click.echo(f"{folder.name.ljust(width)}  {title(folder)}")
        tell("mor examples NAME copies one of them")
        return
    target = output or Path(name)
    copy_sample(name, target)
    tell(f"{target / 'project.yaml'}: {title(target)}")


def sample_projects() -> list[Path]:
    """Folders of the sample projects: of the installed package, or of the source tree."""
    import mor

    package = Path(mor.__file__).parent
    for place in (package / "examples", package.parent / "sample_projects"):
        if found := sorted(path.parent for path in place.glob("*/project.yaml")):
            return found
    raise InputError([Message("this installation does not include the sample projects")])


def title(folder: Path) -> str:
    """First heading of a sample's README."""
    first = (folder / "README.md").read_text(encoding="utf-8").split("\n", 1)[0]
    return first.removeprefix("# ").strip()


def copy_sample(name: str, target: Path) -> None:
    """Copy a sample into a folder that does not exist, is empty, or has that copy already.

    Raises :class:`mor.errors.InputError`.
    """
    import filecmp
    import shutil

    from mor.output_files import named, write_files

    known = {folder.name: folder for folder in sample_projects()}
    if name not in known:
        words = f"unknown sample project {name!r}{nearest(name, known)} (known: {', '.join(known)})"
        raise InputError([Message(words)])
    sample = known[name]
    files = [path.relative_to(sample) for path in sample.rglob("*") if path.is_file()]
    left_out = shutil.ignore_patterns("__pycache__", "expected.json", "*.results")
    wanted = [str(path) for path in files if not left_out("", list(path.parts))]
    with named(target):
        if filecmp.cmpfiles(sample, target, wanted, shallow=False)[0] == wanted:
            return
        if target.exists() and (not target.is_dir() or any(target.iterdir())):
            words = "this exists and is not an empty folder; choose another one with -o"
            raise InputError([Message(words, str(target))])
        write_files({target / name: (sample / name).read_bytes() for name in wanted}, False, makes_folders=True)
