"""Observation types, parameter blocks, frames, cameras and the Earth: equations and derivatives."""
