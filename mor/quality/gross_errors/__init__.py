"""Data snooping and robust estimation."""
