"""One trial: a mistake planted into a sample project, adjusted, and what the program says of it."""

from __future__ import annotations

import json
import tempfile
from collections.abc import Callable
from functools import cache
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np

from tests.scenarios.mixtures.ingredients import mixture
from tests.scenarios.mixtures.project_file import write_project
from tests.scenarios.planted_mistakes import (
    of_images,
    of_instruments,
    of_mixtures,
    of_more,
    of_names,
    of_units,
)
from tests.scenarios.planted_mistakes.survey import NAMES, survey
from tests.scenarios.planted_mistakes.truth import NotHereError, Planted
from tests.scenarios.small_projects import mor

KINDS = {
    function.__name__: function
    for function in (
        of_names.exchanged_in_image,
        of_names.misnumbered_in_image,
        of_names.exchanged_control,
        of_names.misnumbered_at_station,
        of_names.exchanged_at_station,
        of_names.wrong_station,
        of_instruments.offset,
        of_instruments.scale,
        of_instruments.instrument_height,
        of_instruments.target_height,
        of_instruments.circle_in_degrees,
        of_instruments.counterclockwise,
        of_instruments.elevation,
        of_instruments.other_face,
        of_instruments.slope_for_horizontal,
        of_instruments.levelling_sign,
        of_images.flipped,
        of_images.one_flipped,
        of_images.turned,
        of_images.image_unit,
        of_images.pixel_size,
        of_images.focal_length,
        of_units.control_unit,
        of_units.axes_exchanged,
        of_units.sigma_unit,
        of_more.set_ups_exchanged,
        of_more.station_exchanged_in_directions,
        of_more.images_exchanged,
        of_more.other_camera,
        of_more.control_moved,
        of_more.distance_unit,
        of_more.levelling_unit,
        of_more.orientation_changed,
        of_more.sigma_factor,
        of_more.pixel_origin,
        of_more.two_levelling_signs,
        of_more.instrument_height_in_centimetres,
        of_more.target_height_sign,
    )
}
_TRIES = 100
LIMIT = 120
"""Seconds of a diagnosis."""
VISIBLE = 17.07
"""Non-centrality that a test of level 0.001 finds with a probability of 0.80 (W. Baarda 1968): what changes v'Pv by
less cannot be told from chance by anybody."""


class Trial(NamedTuple):
    """Outcome of a planted mistake."""

    kind: str
    sample: str
    things: tuple[str, ...]
    code: int
    outcome: str
    """How the adjustment of all observations ended; ``input`` where it did not begin."""
    rejected: bool
    """True where something was rejected or left out, or there is no solution."""
    visible: bool
    """True where there is no solution, or v'Pv differs by more than VISIBLE from that without the mistake."""
    place: int | None
    """Place of the right cause among the hypotheses, from 0; nothing where it is not among them."""
    offered: tuple[str, ...]
    scored: int | None = None
    """Place of the right cause among the score tests of the adjustment, from 0."""
    listed: tuple[str, ...] = ()
    """Causes that the score tests name."""


def trial(kind: str, seed: int, keep: Path | None = None, sample: str = "") -> Trial:
    """Plant a mistake of a kind into a sample project, chosen by the seed where none is named, and adjust."""
    random = np.random.default_rng([seed, list(KINDS).index(kind)])
    for _ in range(_TRIES):
        name = str(random.choice(NAMES))
        chosen = survey(sample or name)
        try:
            planted = KINDS[kind](chosen, random)
        except NotHereError:
            continue
        break
    else:
        raise NotHereError
    with tempfile.TemporaryDirectory() as folder:
        return judged(kind, chosen.name, planted, chosen.write(keep or Path(folder)), _without)


def mixture_trial(seed: int, keep: Path | None = None) -> Trial:
    """Plant a mistake into a mixture of everything; both are chosen by the seed."""
    kinds = sorted(of_mixtures.KINDS)
    random = np.random.default_rng([seed, 39])
    with tempfile.TemporaryDirectory() as scratch:
        folder = keep or Path(scratch)
        for attempt in range(_TRIES):
            kind = str(random.choice(kinds))
            number = 1000 * seed + attempt
            sound = write_project(mixture(number), folder / "sound")[0]
            world = mixture(number)
            try:
                planted = of_mixtures.KINDS[kind](world, random)
            except NotHereError:
                continue
            run = mor("adjust", sound, "--json", "-q")
            if run.code != 0:
                continue  # it has no solution without a mistake
            statistic = _statistic(json.loads(run.out))
            project = write_project(world, folder / "wrong")[0]
            return judged(f"mixture: {kind}", f"mixture {number}", planted, project, lambda _, s=statistic: s)
    raise NotHereError


def judged(kind: str, sample: str, planted: Planted, project: Path, without: Callable[[str], float]) -> Trial:
    """Adjust and diagnose a project with a mistake; ``without`` returns v'Pv of the project without it."""
    run = mor("adjust", project, "--json", "-q")
    told = mor("diagnose", project, "--json", "-q", "--limit", str(LIMIT))
    found = json.loads(told.out)["offered"] if told.out else []
    places = [place for place, hypothesis in enumerate(found) if planted.is_named_by(hypothesis)]
    place, things = (places[0] if places else None), tuple(sorted(planted.things))
    if place is not None and found[place]["like_the_first"]:
        place = 0  # the observations cannot tell it from the first
    offered = tuple(map(_described, found))
    if not run.out:
        return Trial(kind, sample, things, run.code, "input", True, True, place, offered or (run.err[:200],))
    results = json.loads(run.out)
    scored = [k for k, one in enumerate(results["possible_causes"]) if planted.is_named_by(one)]
    return Trial(
        kind,
        sample,
        things,
        run.code,
        results["suspects"]["outcome"] if results.get("suspects") else results["outcome"],
        run.code != 0 or not results["global_test"]["accepted"],
        run.code != 0 or bool(results["suspects"]) or abs(_statistic(results) - without(sample)) > VISIBLE,
        place,
        offered,
        scored[0] if scored else None,
        tuple(map(_described, results["possible_causes"])),
    )


def _described(hypothesis: dict[str, Any]) -> str:
    return f"{hypothesis['cause']} ({', '.join(hypothesis['things'])})"


@cache
def _without(sample: str) -> float:
    """v'Pv of a sample project without a mistake."""
    with tempfile.TemporaryDirectory() as folder:
        run = mor("adjust", survey(sample).write(Path(folder)), "--json", "-q")
    return _statistic(json.loads(run.out))


def _statistic(results: dict[str, Any]) -> float:
    return float(results["global_test"]["statistic"])
