"""Kinds of parameter blocks, their values, and the index from block to column."""
