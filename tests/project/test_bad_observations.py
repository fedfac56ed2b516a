"""Mistakes in observations, their units and covariances, in observed parameters and in features."""

from __future__ import annotations

from pathlib import Path

import pytest

from tests.mistakes import TRIANGLE, VECTOR, mistakes, with_observations, wrong, wrong_block
from tests.scenarios.small_projects import BLOCK, mor, write


class TestObservations:
    def test_angle_with_two_equal_targets(self, tmp_path: Path) -> None:
        entry = "  - {type: angle, columns: [at, from, to, angle, sigma], rows: [[A, C, C, 0, 1]]}"
        assert with_observations(tmp_path, entry) == [
            "project.yaml:7: from and to are the same: 'C'; angle needs two different ones"
        ]

    def test_sight_to_itself(self, tmp_path: Path) -> None:
        entry = "  - {type: bearing, columns: [from, to, bearing, sigma], rows: [[A, A, 0, 1]]}"
        assert with_observations(tmp_path, entry) == [
            "project.yaml:7: from and to are the same: 'A'; bearing needs two different ones"
        ]

    def test_one_target_is_enough_where_the_orientation_is_known(self, tmp_path: Path) -> None:
        station = "stations:\n  - {columns: [id, point, orientation], rows: [[S, A, 0]], fixed: [kappa]}\n"
        entry = "  - {type: directions, columns: [station, to, horizontal, sigma], rows: [[S, C, 35.6, 1]]}\n"
        assert mor("check", write(tmp_path, TRIANGLE + entry + station)).code == 0

    def test_targets_of_one_set_may_stand_in_two_groups(self, tmp_path: Path) -> None:
        entry = "  - {type: directions, columns: [station, to, horizontal, sigma], rows: [[A, %s, 10, 1]]}\n"
        assert mor("check", write(tmp_path, TRIANGLE + entry % "B" + entry % "C")).code == 0

    def test_zenith_angles_alone_orient_nothing(self, tmp_path: Path) -> None:
        entry = "  - {type: zenith_directions, columns: [station, to, zenith, sigma], rows: [[A, C, 96, 1]]}"
        found = with_observations(tmp_path, entry)
        assert len(found) == 1
        assert "use type zenith_angle for zenith angles alone" in found[0]

    def test_nothing_observed_in_a_row(self, tmp_path: Path) -> None:
        entry = "  - {type: vector, columns: [from, to, dx, dy, dz, sigma], rows: [[A, C, '', '', '', 1]]}"
        assert with_observations(tmp_path, entry) == ["project.yaml:7: nothing is observed in this row"]

    def test_vector_without_sigma_or_covariance(self, tmp_path: Path) -> None:
        entry = "  - {type: vector, columns: [from, to, dx, dy, dz], rows: [[A, C, 50, 80, 5]]}"
        assert with_observations(tmp_path, entry) == [
            "project.yaml:7: no σ: give a column sigma, or values: {sigma: …} for all rows; or covariances"
        ]

    @pytest.mark.parametrize(
        ("matrix", "words"),
        [
            ("[[1, 0, 0], [0, 1, 2], [0, 2, 1]]", "the covariance matrix is not positive definite"),
            (
                "[[1, 0, 0], [0, -1, 0], [0, 0, 1]]",
                "a variance, or the σ instead of it, is zero, negative or missing",
            ),
            ("[[1, 0, 0], [0.1, 1, 0], [0, 0, 1]]", "the covariance matrix is not symmetric"),
            ("[[1, 0], [0, 1]]", "covariance: found 2 × 2, expected 3 × 3"),
            ("[[1, 0, 0], [0, 1], [0, 0, 1]]", "covariance: rows of different length"),
            ("matrix.csv", "covariance: file 'matrix.csv' does not exist"),
        ],
    )
    def test_covariance_matrix(self, tmp_path: Path, matrix: str, words: str) -> None:
        found = with_observations(tmp_path, VECTOR + matrix + "}")
        assert len(found) == 1
        assert found[0].startswith("project.yaml:7: ")
        assert words in found[0]

    def test_covariances_in_columns(self, tmp_path: Path) -> None:
        columns = "[from, to, dx, dy, dz, cov_dx_dx, cov_dx_dy, cov_dy_dy, cov_dz_dz]"
        entry = f"  - {{type: vector, columns: {columns}, rows: [[A, C, 50, 80, 5, 1, 2, 1, 1]]}}"
        found = with_observations(tmp_path, entry)
        assert len(found) == 1
        assert found[0].startswith("project.yaml:7: the covariance matrix is not positive definite")

    def test_covariance_file_that_holds_no_numbers(self, tmp_path: Path) -> None:
        project = write(tmp_path, TRIANGLE + VECTOR + "matrix.csv}\n", matrix="1,0,0\n0,x,0\n0,0,1\n")
        assert mistakes(project) == ["matrix.csv:2: found 'x', expected a number"]

    def test_no_observations(self, tmp_path: Path) -> None:
        project = write(tmp_path, TRIANGLE.split("observations:")[0])
        assert mistakes(project) == ["project.yaml:1: there are no observations"]


class TestUnits:
    def test_in_a_cell(self, tmp_path: Path) -> None:
        found = wrong(tmp_path, "1.002", "1.002 gon")
        assert len(found) == 1
        assert found[0].startswith("project.yaml:9: dz: unit 'gon' does not fit a length (known: m, dm, cm, mm,")

    @pytest.mark.parametrize("unit", ["gon", "mmm"])
    def test_of_a_table(self, tmp_path: Path, unit: str) -> None:
        found = wrong(tmp_path, "type: height_difference", f"type: height_difference\n    units: {unit}")
        assert len(found) == 1
        assert found[0].startswith(f"project.yaml:8: unit '{unit}' fits none of the columns (dz,")

    def test_of_a_column(self, tmp_path: Path) -> None:
        entry = "  - {type: angle, columns: [at, from, to, angle, sigma], units: {angle: m}, rows: [[A, B, C, 9, 1]]}"
        found = with_observations(tmp_path, entry)
        assert len(found) == 1
        assert "angle: unit 'm' does not fit an angle (known: rad," in found[0]

    def test_of_image_coordinates(self, tmp_path: Path) -> None:
        found = wrong_block(tmp_path, BLOCK.replace("2 um", "2 gon"))
        assert found == ["project.yaml:10: unit 'gon' does not fit image coordinates"]

    def test_pixels_need_their_size(self, tmp_path: Path) -> None:
        found = wrong_block(tmp_path, BLOCK.replace("2 um", "0.1 px"))
        assert found == ["project.yaml:10: pixels need image: {width, height, pixel} in the camera"]

    def test_unknown_in_the_head(self, tmp_path: Path) -> None:
        found = wrong(tmp_path, "{length: m}", "{length: meter}")
        assert found[0].startswith("project.yaml:2: units → length: found 'meter', expected 'm', 'dm', ")

    def test_minutes_beyond_sixty(self, tmp_path: Path) -> None:
        columns = "columns: [from, to, bearing, sigma], units: {bearing: dms}"
        entry = f"  - {{type: bearing, {columns}, rows: [[A, C, 32-61-0, 1]]}}"
        assert with_observations(tmp_path, entry) == [
            "project.yaml:7: bearing: '32-61-0': minutes and seconds must stay below 60"
        ]


class TestParameters:
    def found(self, folder: Path, row: str) -> list[str]:
        entry = f"  - {{type: parameter, columns: [of, component, value, sigma], rows: [{row}]}}"
        return with_observations(folder, entry)

    @pytest.mark.parametrize(
        ("row", "words"),
        [
            ("[point C, w, 1, 1]", "point C has no component 'w' (known: x, y, z)"),
            ("[pont C, x, 1, 1]", "found 'pont C', expected one of camera …, image …"),
            ("[point D, x, 1, 1]", "point 'D' does not exist"),
            ("[point C, x, 1, -1]", "sigma: found -1, expected a σ ≥ 0"),
            ("[point C, x, one, 1]", "value: found 'one', expected a number, with or without a unit"),
            ("[point C, x, 1 gon, 1]", "value: unit 'gon' does not fit a length"),
        ],
    )
    def test_wrong_row(self, tmp_path: Path, row: str, words: str) -> None:
        found = self.found(tmp_path, row)
        assert len(found) == 1
        assert found[0].startswith(f"project.yaml:7: {words}")

    def test_camera_without_eccentricity(self, tmp_path: Path) -> None:
        entry = "  - {type: parameter, columns: [of, component, value, sigma], rows: [[camera K, rx, 1, 0]]}\n"
        found = wrong_block(tmp_path, BLOCK.replace("datum: free", entry + "datum: free"))
        assert found == ["project.yaml:13: camera K has no rx of its own: give it one where it is declared"]


class TestFeatures:
    def test_too_few_points(self, tmp_path: Path) -> None:
        text = TRIANGLE + "features: [{type: plane, id: wall, points: [A, B, C], sigma: 0.001}]\n"
        assert mistakes(write(tmp_path, text)) == [
            "project.yaml:7: a plane observes nothing with 3 points; it needs 4 or more"
        ]

    def test_unknown_point(self, tmp_path: Path) -> None:
        text = TRIANGLE + "features: [{type: line, id: edge, points: [A, B, D, C], sigma: 0.001}]\n"
        assert mistakes(write(tmp_path, text)) == ["project.yaml:7: point 'D' does not exist"]


class TestHeightsOfInstruments:
    """A point and a station over it differ by the height of the instrument, and that is said."""

    STATION = "stations:\n  - {columns: [id, point, height], rows: [[S, A, 1.5]]}\n"

    @pytest.mark.parametrize(
        ("kind", "columns", "row"),
        [
            ("distance", "from, to, distance", "A, C, 9"),
            ("zenith_angle", "from, to, zenith_angle", "A, C, 96"),
            ("zenith_directions", "station, to, horizontal, zenith", "A, C, 10, 96"),
        ],
    )
    def test_a_sight_from_the_point_is_noted(self, tmp_path: Path, kind: str, columns: str, row: str) -> None:
        entry = f"  - {{type: {kind}, columns: [{columns}, sigma], rows: [[{row}, 1]]}}\n"
        run = mor("check", write(tmp_path, TRIANGLE + entry + self.STATION))
        assert run.code == 0, run.err
        assert "'A' is the point itself; the height of the instrument counts where station 'S' over it" in run.err

    @pytest.mark.parametrize(
        "entry",
        [
            "{type: distance, columns: [from, to, distance, sigma], rows: [[S, C, 9, 1]]}",
            "{type: distance, columns: [from, to, distance, sigma, from_height], rows: [[A, C, 9, 1, 1.6]]}",
            "{type: height_difference, columns: [from, to, dz, sigma], rows: [[A, C, 1, 1]]}",
        ],
    )
    def test_nothing_is_noted_where_it_is_clear(self, tmp_path: Path, entry: str) -> None:
        run = mor(
            "check",
            write(tmp_path, TRIANGLE.replace("[A, C, 94", "[C, A, 94") + f"  - {entry}\n" + self.STATION),
        )
        assert run.code == 0, run.err
        assert "the point itself" not in run.err
