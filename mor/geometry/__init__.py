"""Rotations, frames, camera models, similarity: mathematics only."""
