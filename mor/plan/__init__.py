"""Planned networks: requirements, ranking, simulation, visibility."""
