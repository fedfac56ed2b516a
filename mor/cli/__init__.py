"""The command line: one file for each command, loaded when it is called."""

from __future__ import annotations

import importlib
import sys
from collections.abc import Sequence

import click

from mor import __version__
from mor.errors import ExitCode, MorError

COMMANDS = {
    "new": "Begin a commented project from the tables there are.",
    "adjust": "Adjust a project and write report, results and tables.",
    "compare": "Compare two results: as a regression test, or as two epochs.",
    "covariance": "Covariances of chosen points, or of everything, with labels.",
    "datum": "Results in another datum, without a new adjustment.",
    "approximate": "Find start values, write a project that has them.",
    "check": "Read and check a project, adjust nothing.",
    "orient": "Orient two images (Rinner) or a plane object (Killian).",
    "plot": "Draw a picture of results: network, residuals, camera …",
    "convert": "Write a foreign file as a project file.",
    "examples": "List the sample projects, copy one.",
    "explain": "Say what a term, a column or a code means.",
    "schema": "Print the JSON Schema of the project file.",
}


INTERRUPTED = 130
"""Exit code after Ctrl-C, as shells have it."""


class _Lazy(click.Group):
    """Commands are imported when they are called: ``mor --help`` imports nothing heavy."""

    def list_commands(self, ctx: click.Context) -> list[str]:
        return list(COMMANDS)

    def get_command(self, ctx: click.Context, name: str) -> click.Command | None:
        if name not in COMMANDS:
            return None
        command: click.Command = importlib.import_module(f"mor.cli.{name}").command
        return command

    def format_commands(self, ctx: click.Context, formatter: click.HelpFormatter) -> None:
        with formatter.section("Commands"):
            formatter.write_dl(list(COMMANDS.items()))

    def resolve_command(
        self, ctx: click.Context, args: list[str]
    ) -> tuple[str | None, click.Command | None, list[str]]:
        return super().resolve_command(ctx, args)


@click.group(cls=_Lazy, context_settings={"help_option_names": ["-h", "--help"]})
@click.version_option(__version__, prog_name="mor", message="%(prog)s %(version)s")
def group() -> None:
    """One least-squares adjustment for everything measured around an object.

    \b
    Examples:
      mor check project.yaml
      mor adjust project.yaml
      mor adjust project.yaml -o results --force
      mor adjust project.yaml --json | jq .sigma0
    """


def main(arguments: Sequence[str] | None = None) -> None:
    """Run the command line and exit with the documented code."""
    sys.exit(run(arguments))


def run(arguments: Sequence[str] | None = None) -> int:
    """Run the command line; returns the exit code instead of leaving the process."""
    try:
        result = group.main(args=list(arguments) if arguments is not None else None, standalone_mode=False)
    except click.exceptions.Exit as leaving:
        return leaving.exit_code
    except click.ClickException as error:
        error.show()
        return ExitCode.INPUT
    except (KeyboardInterrupt, click.Abort):
        click.echo("interrupted; no file was left incomplete", err=True)
        return INTERRUPTED
    except MorError as error:
        click.echo(str(error), err=True)
        return error.exit_code
    except BrokenPipeError:
        return ExitCode.DONE
    except OSError as error:
        place = f"{error.filename}: " if error.filename else ""
        click.echo(f"{place}{error.strerror or error}", err=True)
        return ExitCode.INPUT
    except Exception as error:  # noqa: BLE001 - the last resort: one line, and how to see more
        return _internal(error)
    return int(result) if isinstance(result, int) else ExitCode.DONE


def _internal(error: Exception) -> int:
    import os
    import traceback

    if os.environ.get("MOR_DEBUG"):
        traceback.print_exception(error)
    name = type(error).__name__
    click.echo(f"internal error: {name}: {error} (MOR_DEBUG=1 shows where; please report it)", err=True)
    return ExitCode.INTERNAL
