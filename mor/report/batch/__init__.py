"""The table of many projects: as text, JSON, a page, and for CI as JUnit XML."""
