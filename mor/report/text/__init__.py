"""Sections of the text report, one file for each."""
