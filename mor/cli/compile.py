"""``mor compile``."""

from __future__ import annotations

from functools import partial
from pathlib import Path
from tempfile import TemporaryDirectory

import click

from mor.cli.console import language_of_command, tell
from mor.cli.options import quiet_option
from mor.errors import ExitCode, InputError, Message


@click.command(name="compile")
@quiet_option
def command(quiet: bool) -> int:
    """Compile the kernels for large projects before they are first used.

    \b
    Examples:
      mor compile
      NUMBA_CACHE_DIR=/opt/mor/cache mor compile --quiet

    mor adjusts the sample projects with compiled kernels and keeps the machine code in the cache of the user, or in
    the folder NUMBA_CACHE_DIR. Projects with 20 000 observations or more then use it. Without it they are adjusted in
    NumPy, with the same results, unless a project is so large that compiling first is faster. An existing cache is
    replaced.

    \b
    Exit codes: 0 done; 2 Numba is missing or does not compile, or the cache cannot be written.
    """
    from mor.cli.examples import sample_projects
    from mor.cli.progress import progress
    from mor.linalg import compilation
    from mor.report.language import words_of

    if not compilation.available:
        raise InputError([Message(compilation.MISSING)])
    words = words_of(language_of_command())
    with TemporaryDirectory() as folder, progress(quiet, False, words=words) as say:
        steps = [
            partial(_adjusted, sample, Path(folder) / f"{sample.name} {n}", options)
            for sample in sample_projects()
            # Of the adjustments that call all kernels between them.
            for n, options in enumerate((("--no-html",), ("--no-html", "--snoop")))
        ]
        more = say.phase("compiling", len(steps))
        try:
            kept = compilation.compile_all(steps, partial(more, 1))
        except Exception as error:
            raise InputError([Message(compilation.reason_of(error))]) from error
    if not quiet:
        tell(f"kernels in {kept}")
    return ExitCode.DONE


def _adjusted(sample: Path, folder: Path, options: tuple[str, ...]) -> None:
    from mor.cli.adjust import command as adjust

    arguments = [str(sample / "project.yaml"), "-o", str(folder), "--quiet", *options]
    with adjust.make_context("adjust", arguments) as context:
        adjust.invoke(context)
