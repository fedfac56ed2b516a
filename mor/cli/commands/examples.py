"""``mor examples``."""

from __future__ import annotations

from pathlib import Path

import click


@click.command(name="examples")
@click.argument("name", required=False)
@click.option(
    "-o",
    "--output",
    metavar="FOLDER",
    type=click.Path(path_type=Path),
    show_default="NAME",
    help="Folder to copy it to; new, or empty.",
)
def command(name: str | None, output: Path | None) -> None:
    """List the sample projects, or copy the one called NAME.

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
        click.echo("mor examples NAME copies one of them", err=True)
        return
    target = output or Path(name)
    copy_sample(name, target)
    click.echo(f"{target / 'project.yaml'}: {title(target)}", err=True)


def sample_projects() -> list[Path]:
    """Folders of the sample projects: of the installed package, or of the source tree."""
    import mor
    from mor.errors import InputError, Problem

    package = Path(mor.__file__).parent
    for place in (package / "examples", package.parent / "sample_projects"):
        if found := sorted(path.parent for path in place.glob("*/project.yaml")):
            return found
    raise InputError([Problem("this installation came without its sample projects")])


def title(folder: Path) -> str:
    """First heading of a sample's README."""
    first = (folder / "README.md").read_text(encoding="utf-8").split("\n", 1)[0]
    return first.removeprefix("# ").strip()


def copy_sample(name: str, target: Path) -> None:
    """Copy a sample into a folder that does not exist or is empty. Raises :class:`mor.errors.InputError`."""
    import shutil

    from mor.errors import InputError, Problem, nearest

    known = {folder.name: folder for folder in sample_projects()}
    if name not in known:
        words = f"unknown sample project {name!r}{nearest(name, known)} (known: {', '.join(known)})"
        raise InputError([Problem(words)])
    if target.exists() and (not target.is_dir() or any(target.iterdir())):
        raise InputError([Problem("this exists and is not an empty folder; -o names another", str(target))])
    ignored = shutil.ignore_patterns("__pycache__", "expected.json", "*.results")
    shutil.copytree(known[name], target, ignore=ignored, dirs_exist_ok=True)
