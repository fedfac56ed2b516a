"""Count the networks that do not start from nothing without each rule of the start values.

    python benchmarks/start_rules.py --seeds 40 --first 1

Each rule is switched off in the networks in which it did anything: mixtures, mixtures with 3 % wrong identities,
composed surveys, surveys of one kind, single situations, and few images of few points. A network counts where the
adjustment from the truth converges, and the one with nothing given reaches the same with all rules.
"""

from __future__ import annotations

import argparse
import sys
import tempfile
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

sys.path[:0] = [str(Path(__file__).parents[1])]

from mor.start import assembly, scene  # noqa: E402
from tests.scenarios.few_points import few_points  # noqa: E402
from tests.scenarios.mixtures.ingredients import mixture, wrong_identities  # noqa: E402
from tests.scenarios.mixtures.project_file import write_project  # noqa: E402
from tests.scenarios.mixtures.situations import SITUATIONS, situation  # noqa: E402
from tests.scenarios.mixtures.surveys.composed import composed  # noqa: E402
from tests.scenarios.mixtures.surveys.newer import NEWER  # noqa: E402
from tests.scenarios.mixtures.surveys.tied import tied  # noqa: E402
from tests.scenarios.mixtures.trial import compared  # noqa: E402

RULES: dict[str, tuple[Any, str, Any]] = {
    "parts begin with levelled stations": (assembly, "seed_levelled", None),
    "parts begin with a pair of images": (assembly, "seed_bundles", (None, None)),
    "parts begin with one of several orientations of a pair": (assembly, "seed_doubtful", None),
    "parts begin with polar points of tilted instruments": (assembly, "seed_polar", None),
    "parts begin with three stations that do not see each other": (assembly, "seed_plan", (None, None)),
    "parts begin with distances alone": (assembly, "seed_distances", None),
    "parts begin with measured coordinates": (assembly, "rigid_seeds", []),
    "resection, intersection, local adjustment": (assembly, "grow_bundles", False),
    "levelled instruments: polar points, intersections, free stations": (assembly, "grow_levelled", False),
    "tilted instruments: polar points": (assembly, "grow_polar", False),
    "followers of stereo pairs": (assembly, "grow_relative", False),
    "intersections of arcs": (assembly, "grow_arcs", False),
    "single points by all that meets in them": (assembly, "grow_single_points", False),
    "poses again from all known points": (assembly, "pose_again", False),
    "vertical by levelled instruments": (scene, "_level_by_frames", False),
    "joins by common points and poses": (assembly, "join", False),
    "joins by all observations": (assembly, "tie_by_observations", None),
    "last ties: vertical as well as it fits": (assembly, "level_roughly", False),
    "first height of a network": (assembly, "begin_heights", False),
    "tilted stations as if level": (assembly, "place_as_if_level", False),
    "frames of few points at last": (assembly, "pose_the_rest", False),
    "stations level with what they sight": (assembly, "stand_level_with_sights", False),
    "random restarts": (assembly, "from_random_places", None),
}
"""Where each rule is called, and what it returns where it finds nothing."""

Write = Callable[[Path], tuple[Path, Path]]


def networks(first: int, count: int) -> Iterator[tuple[str, Write]]:
    """Yield a name and what writes the projects with nothing and with the truth given."""
    for seed in range(first, first + count):
        for wrong in (0.0, 0.03) if seed % 3 == 0 else (0.0,):
            yield f"mixture {seed}, {wrong:.0%} wrong", lambda folder, s=seed, w=wrong: _mixture(s, w, folder)
        yield f"composed {seed}", lambda folder, s=seed: composed(s, 0.0).write(folder)
        yield f"few points {seed}", lambda folder, s=seed: few_points(s, folder)
    for seed in range(first, first + max(count // 20, 1)):
        for name, survey in {**NEWER, "tied": tied}.items():
            yield f"{name} {seed}", lambda folder, s=seed, make=survey: make(s).write(folder)
        for name in SITUATIONS:
            yield f"{name} {seed}", lambda folder, s=seed, n=name: write_project(situation(n, s), folder)


def _mixture(seed: int, wrong: float, folder: Path) -> tuple[Path, Path]:
    world = mixture(seed)
    wrong_identities(world, wrong)
    return write_project(world, folder)


def main() -> None:
    """Print a row for each rule."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--seeds", type=int, default=20)
    parser.add_argument("--first", type=int, default=1)
    options = parser.parse_args()
    acted: dict[str, list[tuple[str, tuple[Path, Path]]]] = {rule: [] for rule in RULES}
    with tempfile.TemporaryDirectory() as folder:
        counted = 0
        for number, (name, write) in enumerate(networks(options.first, options.seeds)):
            files = write(Path(folder) / str(number))
            here: set[str] = set()
            with Watched(here):
                trial = compared(*files, frozenset())
            if trial.counts and trial.reached:
                counted += 1
                for rule in here:
                    acted[rule].append((name, files))
            elif trial.counts:
                print(f"not reached with all rules: {name}", flush=True)
        print(f"{counted} networks start with all rules\n\n| rule | acts in | lost without it |\n|---|---|---|")
        for rule, where in acted.items():
            lost = [name for name, files in where if not _reached_without(rule, files)]
            some = ": " + ", ".join(lost[:3]) if lost else ""
            print(f"| {rule} | {len(where)} | {len(lost)}{some} |", flush=True)


class Watched:
    """Within it, rules that find anything are added to a set."""

    def __init__(self, acted: set[str]) -> None:
        self.acted = acted

    def __enter__(self) -> None:
        self.kept = {rule: getattr(where, name) for rule, (where, name, _) in RULES.items()}
        for rule, (where, name, _) in RULES.items():
            setattr(where, name, self._wrapped(rule, self.kept[rule]))

    def _wrapped(self, rule: str, work: Callable[..., Any]) -> Callable[..., Any]:
        def wrapped(*arguments: Any, **named: Any) -> Any:
            found = work(*arguments, **named)
            found = list(found) if isinstance(found, Iterator) else found
            if found[0] is not None if isinstance(found, tuple) else found:
                self.acted.add(rule)
            return found

        return wrapped

    def __exit__(self, *_: object) -> None:
        for rule, (where, name, _) in RULES.items():
            setattr(where, name, self.kept[rule])


def _reached_without(rule: str, files: tuple[Path, Path]) -> bool:
    where, name, nothing = RULES[rule]
    kept = getattr(where, name)
    setattr(where, name, lambda *_, **__: nothing)
    try:
        return compared(*files, frozenset()).reached
    except Exception:  # noqa: BLE001 - a rule that others take for granted is needed
        return False
    finally:
        setattr(where, name, kept)


if __name__ == "__main__":
    main()
