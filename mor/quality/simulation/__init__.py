"""Simulated measurements: what instruments would show at a known place, with errors of known size."""
