"""``python -m tools.shutter_flight_trials --count 200 [--cubic]``: rolling shutters on trajectories against theory.

Flights of :mod:`shutter_flights` with so many sets of errors; the readout time is free and starts 10 ms beside the
truth. Said are errors over σ of all points, of the positions of knots and of the readout time.
"""

from __future__ import annotations

import argparse
import tempfile
from pathlib import Path

import numpy as np

from mor.api.pipeline import read_document, read_network, solve_network
from mor.linalg.compilation import chosen_by_size
from mor.quality.solution import Solved
from mor.report.estimates import knot_table
from sample_projects.expected import parameter_results, point_results, quality_of
from sample_projects.trials import Trial, say
from tests.scenarios.shutter_flights import READOUT, Files, simulated


def solved(given: Files, folder: Path) -> Solved:
    """The project of the files, adjusted."""
    for name, text in given.files.items():
        (folder / name).write_text(text, encoding="utf-8")
    with chosen_by_size(100_000):
        return solve_network(read_network(read_document(folder / "project.yaml"), folder))


def errors(given: Files, found: Solved) -> tuple[list[float], list[float]]:
    """Errors of points and of positions of knots, of the readout time last, and σ a priori."""
    quality, results = quality_of(found), point_results(found)
    both = [(results[name], place) for name, place in given.points.items()]
    places = np.concatenate([flight.places for flight in given.flights.values()])
    knots = knot_table(found).select("x", "y", "z", "sx", "sy", "sz").rows()
    both += list(zip(map(list, knots), places, strict=True))
    error = [value - true for result, place in both for value, true in zip(result[:3], place, strict=True)]
    sigma = [value for result, _ in both for value in result[3:]]
    value, spread = next(v for (kind, _, _), v in parameter_results(found).items() if kind == "readout")
    return [*error, value - READOUT], list(np.array([*sigma, spread]) / quality.sigma_factor)


def trial(seed: int, cubic: bool) -> Trial:
    """One set of errors."""
    given = simulated(seed, cubic)
    with tempfile.TemporaryDirectory() as place:
        found = solved(given, Path(place))
    error, sigma = errors(given, found)
    quality = quality_of(found)
    return Trial(quality.sigma0, quality.redundancy, np.array(error) / np.array(sigma))


def main() -> None:
    """Print what the trials give."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--count", type=int, default=200)
    parser.add_argument("--cubic", action="store_true")
    asked = parser.parse_args()
    trials = [trial(seed, asked.cubic) for seed in range(1, asked.count + 1)]
    say(trials)
    readout = np.array([one.ratios[-1] for one in trials])
    print(f"readout time error/sigma rms {np.sqrt(np.mean(readout**2)):.3f}, mean {readout.mean():+.3f}")


if __name__ == "__main__":
    main()
