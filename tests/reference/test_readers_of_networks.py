"""What is read from the files of other programs is the network that stands in this repository."""

from __future__ import annotations

import json

import numpy as np
import pytest

from mor.formats import read_foreign
from tests.reference_data import (
    NETWORKS,
    expected_values,
    network_name,
    network_of,
    network_of_yaml,
    reference_file,
)

FROM_FILES = [path for path in NETWORKS if "file" in expected_values(path)]


@pytest.mark.parametrize("path", FROM_FILES, ids=network_name)
def test_the_file_holds_the_same_network(path):
    file = reference_file(expected_values(path)["file"])
    read = network_of(read_foreign(file), file.parent)
    kept = network_of_yaml(path.read_text(encoding="utf-8"), path.parent)
    assert read.project.settings.dimensions == kept.project.settings.dimensions
    assert read.project.settings.sigma0 == kept.project.settings.sigma0
    np.testing.assert_array_equal(read.edge.matrix, kept.edge.matrix)
    assert [g.type.key for g in read.groups] == [g.type.key for g in kept.groups]
    for one, other in zip(read.groups, kept.groups, strict=True):
        assert [list(names) for names in one.references] == [list(names) for names in other.references]
        for array in ("observed", "sigma", "constants"):
            np.testing.assert_array_equal(getattr(one, array), getattr(other, array))
    assert len(read.correlations) == len(kept.correlations)
    for one, other in zip(read.correlations, kept.correlations, strict=True):
        for mine, theirs in zip(one, other, strict=True):
            np.testing.assert_array_equal(mine, theirs)
    assert read.blocks.keys() == kept.blocks.keys()
    for kind, blocks in read.blocks.items():
        assert blocks.ids == kept.blocks[kind].ids
        np.testing.assert_array_equal(blocks.free, kept.blocks[kind].free)
        np.testing.assert_array_equal(read.start[kind], kept.start[kind])
    assert read.datum.free == kept.datum.free
    np.testing.assert_array_equal(read.datum.mask, kept.datum.mask)


def test_every_file_of_the_folders_has_its_network(shared_data):
    files = {f"gama/{path.name}" for path in shared_data("gama").glob("*.gkf")}
    files |= {f"textbook/{path.parent.name}/{path.name}" for path in shared_data("textbook").glob("?D/*.dat")}
    assert files == {expected_values(path)["file"] for path in FROM_FILES}


def test_observations_that_gama_leaves_out_are_noted(shared_data):
    counts = {}
    for path in sorted(shared_data("gama").glob("*.gkf")):
        expected = json.loads(path.with_suffix(".expected.json").read_text(encoding="utf-8"))
        assert len(read_foreign(path).notes) == len(expected["observations_not_used"]), path.name
        counts[path.name] = len(expected["observations_not_used"])
    assert sum(counts.values()) > 0
