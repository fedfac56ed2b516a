"""Seeded mutants of every project there is, run through the command line and judged: ``python -m tests.mutations``."""
