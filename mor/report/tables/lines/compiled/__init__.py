"""Compiled: numbers as text, and whole lines of a table."""
