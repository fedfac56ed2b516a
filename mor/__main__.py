"""``python -m mor``."""

from mor.cli import main

main()
