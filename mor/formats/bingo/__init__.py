"""BINGO's files: image coordinates, control and cameras, orientations."""
