"""AICON flat files."""
