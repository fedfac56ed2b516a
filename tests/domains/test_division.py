"""Tables divided into domains: rays go where their point goes, points where most of their rays come from."""

from __future__ import annotations

from collections import Counter
from pathlib import Path
from typing import Any

import numpy as np
import polars as pl
import pytest
from domains_blocks import Kind, write_block

from mor.pipeline import read_document
from mor.project.domains import division, parts, tables
from mor.project.domains.parts import Parts, divide
from mor.project.file.validation import validate


def divided(project: Path, folder: Path) -> Parts:
    document = read_document(project)
    return divide(validate(document), document, project.parent, folder, 1500)


def rows(found: Parts, section: str) -> pl.DataFrame:
    """All rows of a table with the domain they are in."""
    return pl.concat(
        pl.read_parquet(file).with_columns(domain=pl.lit(d))
        for d in range(found.count)
        for file in found.files((section, 0), d)
    )


@pytest.mark.parametrize("at_a_time", [100, 2_000_000])
def test_points_are_where_most_of_their_rays_come_from(
    at_a_time: int, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(tables, "ROWS_AT_A_TIME", at_a_time)
    monkeypatch.setattr(parts, "ROWS_AT_A_TIME", at_a_time)
    halves: list[np.ndarray] = []

    def halved(*arguments: Any) -> tuple[np.ndarray, Any]:
        found = division.halved(*arguments)
        halves.append(found[0])
        return found

    monkeypatch.setattr(parts, "halved", halved)
    project = write_block(tmp_path / "project", Kind(strips=4, images=8, points=900))
    given = pl.read_parquet(project.parent / "rays.parquet").sample(fraction=1.0, shuffle=True, seed=1)
    given.write_parquet(project.parent / "rays.parquet")
    found = divided(project, tmp_path / "parts")
    assert found.count == len(np.unique(halves[0])) > 3
    rays = rows(found, "observations")
    assert rays.drop("domain").sort(pl.all()).equals(given.sort(pl.all()))
    of_point = dict(rows(found, "points").select("id", "domain").iter_rows())
    assert dict(rays.select("point", "domain").iter_rows()) == of_point
    names = pl.read_parquet(project.parent / "images.parquet")["id"].to_list()
    of_image = dict(zip(names, halves[0].tolist(), strict=True))
    votes: dict[str, Counter[int]] = {}
    for image, point in given.select("image", "point").iter_rows():
        votes.setdefault(point, Counter())[of_image[image]] += 1
    expected = {point: min(some, key=lambda d: (-some[d], d)) for point, some in votes.items()}
    assert {point: of_point[point] for point in expected} == expected


def test_names_with_the_same_hash_are_together(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    plain = parts.hashed
    monkeypatch.setattr(parts, "hashed", lambda names: plain(names) % 97)
    project = write_block(tmp_path / "project", Kind(strips=4, images=8, points=900))
    found = divided(project, tmp_path / "parts")
    of_point = dict(rows(found, "points").select("id", "domain").iter_rows())
    assert found.count > 1
    assert dict(rows(found, "observations").select("point", "domain").iter_rows()) == of_point
