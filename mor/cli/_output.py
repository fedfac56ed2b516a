"""Options that all commands that write share: replace what is there, say nothing."""

from __future__ import annotations

import click

force_option = click.option("-f", "--force", is_flag=True, help="Replace files that are there already.")
quiet_option = click.option("-q", "--quiet", is_flag=True, help="Say nothing but mistakes.")
