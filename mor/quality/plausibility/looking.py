"""Everything there is to look at before an adjustment."""

from __future__ import annotations

from mor.errors import Problem
from mor.project.network.build import Network
from mor.quality.plausibility.full_circle import beyond_a_circle
from mor.quality.plausibility.given_coordinates import steps_from_given_coordinates
from mor.quality.plausibility.images import measured_twice, outside_the_format
from mor.quality.plausibility.known_points import contradicting_known_points
from mor.quality.plausibility.levelling_loops import open_loops
from mor.quality.plausibility.repeated_rows import repeated_rows
from mor.quality.plausibility.set_ups import implausible_heights, vertical_convention
from mor.quality.plausibility.standard_deviations import implausible_sigmas
from mor.quality.plausibility.start_poses import unsupported_poses

_LOOKS = (
    outside_the_format,
    measured_twice,
    repeated_rows,
    implausible_sigmas,
    beyond_a_circle,
    implausible_heights,
    vertical_convention,
    steps_from_given_coordinates,
    contradicting_known_points,
    open_loops,
    unsupported_poses,
)


def implausible(network: Network) -> tuple[Problem, ...]:
    """Notes on observations that cannot be right, or contradict what is known; each with its file and line."""
    return tuple(note for look in _LOOKS for note in look(network))
