"""Hypotheses about mistakes: score tests at the solution, and adjustments that try them."""
