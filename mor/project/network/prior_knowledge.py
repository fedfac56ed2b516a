"""Prior knowledge that stands with the things themselves: observed components, levels, image-variant interiors."""

from __future__ import annotations

import numpy as np

from mor.observations import OBSERVED_DIFFERENCES, OBSERVED_PARAMETERS, PLAIN_TYPES, ObservationGroup
from mor.observations.names import Names, names_of, one_name
from mor.parameters.kinds import INTERIORS
from mor.project.edge import UnitError
from mor.project.network.entities import BlockStore
from mor.project.network.reading import Reading
from mor.units import ANGLE


def prior_groups(reading: Reading) -> list[ObservationGroup]:
    """One group of observed parameters for every kind of block that has a σ somewhere."""
    groups = []
    for kind, store in reading.shop.stores.items():
        sigma = store.all_sigma()
        rows = np.flatnonzero(np.isfinite(sigma).any(axis=1)) if len(sigma) else np.zeros(0, dtype=np.int64)
        if len(rows) == 0:
            continue
        values = store.all_values()[rows]
        groups.append(
            ObservationGroup(
                name=f"observed {kind}",
                type=OBSERVED_PARAMETERS[kind],
                blocks=(rows,),
                observed=np.where(np.isfinite(sigma[rows]), values, np.nan),
                sigma=sigma[rows],
                constants=np.zeros((len(rows), 0)),
                references=(Names(rows.astype(np.int32), tuple(store.ids)),),
                image_unit=_image_unit(reading, store),
            )
        )
    return groups


def _image_unit(reading: Reading, store: BlockStore) -> str:
    """Image unit of the interior orientations of one kind (of the first camera that has it)."""
    for name, camera in reading.project.cameras.items():
        if INTERIORS[camera.model] is store.kind and name in reading.scales:
            return reading.scales[name].unit
    return "mm"


def level_groups(reading: Reading) -> list[ObservationGroup]:
    """Levels observed as zero tilt, in instrument axes, for the stations whose level has a σ."""
    stations = reading.shop.things["station"]
    groups = []
    for number, table in enumerate(reading.project.stations):
        if table.level in ("fixed", "free"):
            continue
        place = reading.at("stations", number)
        try:
            sigma = reading.edge.number(table.level, ANGLE)
        except UnitError as error:
            reading.problems.append(place.problem(str(error), "level"))
            continue
        if sigma <= 0.0:
            reading.problems.append(place.problem("level: expected a σ > 0, or fixed", "level"))
            continue
        names = [n for n in reading.table_ids.get(("stations", number), []) if n not in reading.unoriented]
        if not names:
            continue
        rows = np.array([stations.part(name, "rotation") for name in names], dtype=np.int64)
        groups.append(
            ObservationGroup(
                name=f"levels {number + 1}",
                type=PLAIN_TYPES["level"],
                blocks=(rows,),
                observed=np.zeros((len(rows), 2)),
                sigma=np.full((len(rows), 2), sigma),
                constants=np.zeros((len(rows), 0)),
                references=(names_of(names),),
            )
        )
    return groups


def variant_groups(reading: Reading, variants: dict[str, dict[int, float]]) -> list[ObservationGroup]:
    """Differences of image-variant components from their camera's, observed as zero where they have a σ."""
    groups = []
    cameras, images = reading.shop.things["camera"], reading.shop.things["image"]
    for number, name in enumerate(cameras.ids):
        sigmas = {k: s for k, s in variants.get(name, {}).items() if np.isfinite(s)}
        if not sigmas:
            continue
        kind = INTERIORS[reading.project.cameras[name].model]
        mine = np.flatnonzero(images.parts["camera"] == number)
        observed = np.full((len(mine), kind.size), np.nan)
        sigma = np.full((len(mine), kind.size), np.nan)
        for component, value in sigmas.items():
            observed[:, component], sigma[:, component] = 0.0, value
        shared = np.full(len(mine), cameras.parts["interior"][number])
        groups.append(
            ObservationGroup(
                name=f"image-variant interior of camera {name}",
                type=OBSERVED_DIFFERENCES[kind.key],
                blocks=(shared, images.parts["interior"][mine]),
                observed=observed,
                sigma=sigma,
                constants=np.zeros((len(mine), 0)),
                references=(
                    one_name(f"camera {name}", len(mine)),
                    names_of([f"image {images.ids[i]}" for i in mine]),
                ),
                image_unit=reading.scales[name].unit,
            )
        )
    return groups
