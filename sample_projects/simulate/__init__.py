"""Simulation of the sample projects, independent of the program: known truth, seeded noise, always the same bytes."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from importlib import import_module

SCENES = (
    "facade",
    "test_field",
    "aerial_strip",
    "building",
    "stereo_rig",
    "single_station",
    "machine_part",
    "image_variant",
    "bridge",
    "dam",
    "dam_epochs",
    "panorama",
    "drone_block",
    "three_line_strip",
)
"""Names of the sample projects; each has a module here and a folder beside."""

Files = Mapping[str, str | bytes]
"""Texts, and bytes of what is no text, by file name."""


def simulate(name: str) -> Files:
    """The simulated files of a sample project, by file name relative to its folder."""
    scene: Callable[[], Files] = import_module(f"sample_projects.simulate.{name}").simulate
    return scene()


def content(file: str | bytes) -> bytes:
    """What stands in a file."""
    return file.encode() if isinstance(file, str) else file
