"""The option ``--from``: the format of a foreign file whose content shall not tell."""

from __future__ import annotations

import click

format_option = click.option(
    "--from",
    "source_format",
    metavar="FORMAT",
    help="Format of a foreign PROJECT, where its content shall not tell.",
)
"""``--from`` of the commands that read one project."""
