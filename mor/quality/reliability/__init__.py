"""Redundancy numbers, smallest detectable errors, and what an undetected error does."""
