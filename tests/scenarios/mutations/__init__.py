"""Seeded mutants of every project, run through the command line and judged: ``python -m tests.scenarios.mutations``."""
