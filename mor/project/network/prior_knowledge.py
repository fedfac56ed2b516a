"""Prior knowledge that stands with the things themselves: observed components, levels, image-variant interiors."""

from __future__ import annotations

import numpy as np

from mor.arrays import IntArray
from mor.observations import OBSERVED_DIFFERENCES, OBSERVED_PARAMETERS, PLAIN_TYPES, ObservationGroup
from mor.observations.names import names_of, one_name
from mor.parameters.kinds import INTERIORS
from mor.project.edge import UnitError
from mor.project.network.entities import BlockStore, said_thing
from mor.project.network.reading import Reading, table_label
from mor.units import ANGLE


def prior_groups(reading: Reading) -> list[ObservationGroup]:
    """Groups of observed parameters, called as the table (or camera, or instrument) that has their values and σ.

    One for every table and kind of block, in the order of the tables.
    """
    groups: list[tuple[int, ObservationGroup]] = []
    for kind, store in reading.shop.stores.items():
        sigma = store.all_sigma()
        rows = np.flatnonzero(np.isfinite(sigma).any(axis=1)) if len(sigma) else np.zeros(0, dtype=np.int64)
        source = reading.shop.source(kind)[rows]
        for number in np.unique(source).tolist():
            table = reading.shop.sources[number][0]
            groups.append((number, _prior_group(reading, store, rows[source == number], table)))
    return [group for _, group in sorted(groups, key=lambda numbered: numbered[0])]


def _prior_group(reading: Reading, store: BlockStore, rows: IntArray, table: str) -> ObservationGroup:
    """Observed parameters of the blocks (n,) of one kind that a table, or a camera, declares."""
    values, sigma = store.all_values()[rows], store.all_sigma()[rows]
    camera = store.ids[int(rows[0])]
    return ObservationGroup(
        name=table,
        type=OBSERVED_PARAMETERS[store.kind.key],
        blocks=(rows,),
        observed=np.where(np.isfinite(sigma), values, np.nan),
        sigma=sigma,
        constants=np.zeros((len(rows), 0)),
        references=(names_of([said_thing(store.kind.key, store.ids[row]) for row in rows]),),
        image_unit=reading.scales[camera].unit if camera in reading.scales else "mm",
    )


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
                name=table_label("stations", number, table),
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
    """Differences of image-variant components from their camera's, observed as zero if they have a σ."""
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
