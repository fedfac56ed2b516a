"""Reference networks of this repository: adjusted, and compared number by number with other programs and books.

Each network is a project (``networks/SOURCE/NAME.yaml``) with the expected values beside it (``NAME.expected.json``).
``networks/README.md`` describes the format, the sources and the tolerances. ``mor verify`` makes the same comparison.
"""

from __future__ import annotations

import pytest

from mor.api.verification import About, network_checks
from tests.reference_data import NETWORKS, expected_values, network_name, solved_network, table

AT_LEAST = 60


def test_there_are_enough_networks():
    assert len(NETWORKS) >= AT_LEAST
    for path in NETWORKS:
        assert expected_values(path)["source"], path
        assert expected_values(path)["expected_from"], path


@pytest.mark.parametrize("path", NETWORKS, ids=network_name)
def test_network_agrees_with_its_expected_values(path):
    expected = expected_values(path)
    checks = list(network_checks(path, About("", network_name(path), ""), solved_network(path)))
    assert [check for check in checks if not check.passed] == []
    tables = {name: len(table(expected, name)) for name in ("points", "published", "images", "observations")}
    assert sum(check.numbers for check in checks) >= 6 + 2 * tables["points"] + 2 * tables["published"]
    assert len(checks) >= 4 + 2 * sum(tables[name] > 0 for name in ("points", "published", "images"))
    assert expected["dof"] == expected["n"] - expected["u"] + expected["defect"]
    if all("r" in row for row in table(expected, "observations")):
        assert sum(row["r"] for row in table(expected, "observations")) == pytest.approx(expected["dof"], abs=1e-6)
