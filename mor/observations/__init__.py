"""Observation types: one file each, every one a value of :class:`ObservationType`."""
