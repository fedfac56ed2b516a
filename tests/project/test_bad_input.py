"""Every mistake in the input has words of its own: where it stands, what was found, what was expected."""

from __future__ import annotations

from pathlib import Path

import pytest
from small_projects import BLOCK, LEVELLING, block, mor, table, write, write_block

TRIANGLE = """\
mor: 1
points:
  - {columns: [id, x, y, z], rows: [[A, 0, 0, 0], [B, 100, 0, 0]], fixed: [x, y, z]}
  - {columns: [id, x, y, z], rows: [[C, 50, 80, 5]]}
observations:
  - {type: distance, columns: [from, to, distance, sigma], rows: [[A, C, 94.472, 0.01], [B, C, 94.472, 0.01]]}
"""
VECTOR = "  - {type: vector, columns: [from, to, dx, dy, dz], rows: [[A, C, 50, 80, 5]], covariance: "


def mistakes(project: Path) -> list[str]:
    """What the command line says about a project that is wrong: and it does nothing else than that."""
    before = sorted(project.parent.iterdir())
    run = mor("adjust", project)
    assert run.code == 2
    assert run.out == ""
    assert "Traceback" not in run.err
    assert "internal" not in run.err
    assert sorted(project.parent.iterdir()) == before
    checked = mor("check", project)
    assert (checked.code, checked.out) == (2, "")
    assert checked.err == run.err
    return run.err.replace(f"{project.parent}/", "").splitlines()


def wrong(folder: Path, old: str, new: str, text: str = LEVELLING, **files: str) -> list[str]:
    """Mistakes of a project after one change."""
    assert text.count(old) == 1
    return mistakes(write(folder, text.replace(old, new), **files))


def wrong_block(folder: Path, text: str = BLOCK, **files: str) -> list[str]:
    return mistakes(write_block(folder, text, **files))


def with_observations(folder: Path, *entries: str) -> list[str]:
    """Mistakes of the triangle with further observations, which begin in line 7."""
    return mistakes(write(folder, TRIANGLE + "\n".join(entries) + "\n"))


def test_levelling_without_mistake_is_adjusted(tmp_path: Path) -> None:
    assert mor("adjust", write(tmp_path, LEVELLING)).code == 0


def test_missing_project_file(tmp_path: Path) -> None:
    run = mor("adjust", tmp_path / "nothing.yaml")
    assert (run.code, run.err) == (2, f"{tmp_path}/nothing.yaml: this file does not exist\n")


def test_folder_instead_of_project_file(tmp_path: Path) -> None:
    run = mor("adjust", tmp_path)
    assert run.code == 2
    assert run.err.startswith(f"{tmp_path}: ")
    assert "folder, expected" in run.err
    assert mor("adjust", ".").code == 2


def test_missing_table_names_the_nearest_file(tmp_path: Path) -> None:
    found = wrong(
        tmp_path,
        "columns: [id, x, y, z], rows: [[A, 0, 0, 10]]",
        "file: control.csv",
        contrl="id,x,y,z\nA,0,0,10\n",
    )
    assert found == ["project.yaml:4: file 'control.csv' does not exist; did you mean 'contrl.csv'?"]


@pytest.mark.parametrize("content", ["", "id,x,y,z\n", "# nothing\n"])
def test_empty_table(tmp_path: Path, content: str) -> None:
    rows = "columns: [id, x, y, z], rows: [[A, 0, 0, 10]]"
    assert wrong(tmp_path, rows, "file: control.csv", control=content) == ["control.csv: the table is empty"]


def test_empty_rows(tmp_path: Path) -> None:
    assert wrong(tmp_path, "[[A, 0, 0, 10]]", "[]") == ["project.yaml:4: the table is empty"]


def test_point_in_an_unknown_image(tmp_path: Path) -> None:
    rays = "image,point,x,y\n010,P0,1,2\n10,P0,1,2\n10,P1,1,2\nnoo,P99,1,2\n"
    assert wrong_block(tmp_path, rays=rays) == [
        "rays.csv:3: image '10' does not exist; did you mean '010'?",
        "rays.csv:5: image 'noo' does not exist; did you mean 'no'?",
        "rays.csv:5: point 'P99' does not exist; did you mean 'P9'?",
    ]


@pytest.mark.parametrize("number", ["NaN", "nan", "inf", "-inf", "1,5", "1.2.3", "abc"])
def test_what_is_no_number(tmp_path: Path, number: str) -> None:
    cell = f'"{number}"' if "," in number else number
    found = wrong_block(tmp_path, rays=f"image,point,x,y\n010,P0,1,2\n010,P1,{cell},2\n")
    assert len(found) == 1
    assert found[0].startswith("rays.csv:3: x: found '")
    assert number.lower() in found[0].lower()
    assert "expected a" in found[0]
    found = wrong(tmp_path / "rows", "1.002", f"'{number}'")
    assert found == [f"project.yaml:9: dz: found '{number}', expected a number, with or without a unit"]


def test_empty_cell_where_a_number_is_needed(tmp_path: Path) -> None:
    assert wrong_block(tmp_path, rays="image,point,x,y\n010,P0,1,2\n010,P1,,2\n,P1,1,2\n") == [
        "rays.csv:4: image is empty",
        "rays.csv:3: x is empty",
    ]


class TestSigma:
    def test_negative_in_a_row(self, tmp_path: Path) -> None:
        found = wrong(tmp_path, "1.002, 0.001", "1.002, -0.001")
        assert found == ["project.yaml:9: found a negative σ, expected σ > 0"]

    def test_negative_for_all_rows_is_one_mistake(self, tmp_path: Path) -> None:
        found = wrong_block(tmp_path, BLOCK.replace("2 um", "-2 um"))
        assert len(found) == 1
        assert found[0].startswith("project.yaml:12: sigma: found -2")

    def test_negative_of_a_point_is_one_mistake(self, tmp_path: Path) -> None:
        rows = "columns: [id, x, y, z, sigma], rows: [[A, 0, 0, 10, -1]]"
        found = wrong(tmp_path, "columns: [id, x, y, z], rows: [[A, 0, 0, 10]], fixed: [x, y, z]", rows)
        assert found == ["project.yaml:4: sigma: found a negative σ, expected a σ ≥ 0"]

    def test_negative_of_a_camera(self, tmp_path: Path) -> None:
        found = wrong_block(tmp_path, BLOCK.replace("c: 20", "c: {observed: 20, sigma: -1}"))
        assert found == ["project.yaml:4: c: found a negative σ, expected a σ ≥ 0"]

    def test_zero_is_for_what_is_fixed(self, tmp_path: Path) -> None:
        found = wrong(tmp_path, "1.002, 0.001", "1.002, 0")
        assert found == [
            "project.yaml:9: found σ = 0, expected σ > 0 (what is exactly known is fixed, not observed)"
        ]

    def test_none_at_all_is_said_once(self, tmp_path: Path) -> None:
        found = wrong_block(tmp_path, BLOCK.replace("    values: {sigma: 2 um}\n", ""))
        assert found == ["rays.csv:2: no σ: give a column sigma, or values: {sigma: …} for all rows"]

    def test_none_in_one_row(self, tmp_path: Path) -> None:
        assert wrong(tmp_path, "1.002, 0.001", "1.002, ''") == ["project.yaml:9: no σ in this row"]

    def test_observed_value_without_it(self, tmp_path: Path) -> None:
        found = wrong_block(tmp_path, BLOCK.replace("c: 20", "c: {observed: 20}"))
        assert found == [
            "project.yaml:4: cameras → K → interior → c: "
            "sigma belongs to an observed value, and an observed value needs one"
        ]


class TestColumns:
    def test_one_too_few_in_a_file(self, tmp_path: Path) -> None:
        found = wrong_block(tmp_path, rays="image,point,x,y\n010,P0,1,2\n010,P1,1\nno,P1,1,2,3\n")
        assert found == [
            "rays.csv:3: found 3 columns, expected 4 (image, point, x, y)",
            "rays.csv:4: found 5 columns, expected 4 (image, point, x, y)",
        ]

    def test_one_too_few_in_rows(self, tmp_path: Path) -> None:
        found = wrong(tmp_path, "[A, B, 1.001, 0.001]", "[A, B, 1.001]")
        assert found == ["project.yaml:9: found 3 columns, expected 4 (from, to, dz, sigma)"]

    def test_one_too_many_in_rows(self, tmp_path: Path) -> None:
        found = wrong(tmp_path, "[A, B, 1.001, 0.001]", "[A, B, 1.001, 0.001, 9]")
        assert found == ["project.yaml:9: found 5 columns, expected 4 (from, to, dz, sigma)"]

    def test_missing(self, tmp_path: Path) -> None:
        found = wrong_block(tmp_path, rays="image,point,x\n010,P0,1\n")
        assert found == ["project.yaml:10: column 'y' is missing (found: image, point, x)"]

    def test_another_delimiter_is_guessed(self, tmp_path: Path) -> None:
        found = wrong_block(tmp_path, rays="image;point;x;y\n010;P0;1;2\n")
        assert len(found) == 1
        assert "is ';' the delimiter?" in found[0]

    def test_unknown_with_the_nearest_and_the_known_ones(self, tmp_path: Path) -> None:
        found = wrong(tmp_path, "columns: [from, to, dz, sigma]", "columns: [from, to, dz, sigms]")
        assert len(found) == 1
        assert found[0].startswith(
            "project.yaml:7: unknown column 'sigms'; did you mean 'sigma'? (known here: from,"
        )

    def test_given_twice(self, tmp_path: Path) -> None:
        found = wrong(tmp_path, "columns: [from, to, dz, sigma]", "columns: [from, dz, dz, sigma]")
        assert any("column 'dz' is given twice" in line for line in found)

    def test_height_on_a_type_that_has_none(self, tmp_path: Path) -> None:
        entry = "  - {type: angle, columns: [at, from, to, angle, sigma, to_height], rows: [[A, B, C, 9, 1, 1.5]]}"
        assert with_observations(tmp_path, entry) == [
            "project.yaml:7: unknown column 'to_height' (known here: at, from, to, angle, sigma_angle, sigma)"
        ]


class TestNames:
    def test_two_cameras_of_one_name(self, tmp_path: Path) -> None:
        twice = "  K: {interior: {c: 20}}\n"
        found = wrong_block(tmp_path, BLOCK.replace(twice, twice + twice))
        assert found == ["project.yaml:5: key 'K' is given twice (first in line 4)"]

    def test_two_points_of_one_name(self, tmp_path: Path) -> None:
        found = wrong(tmp_path, "[B, 0, 0, 11]", "[A, 0, 0, 11]")
        assert "project.yaml:5: point 'A' is given twice (first in project.yaml:4)" in found

    def test_two_images_of_one_name(self, tmp_path: Path) -> None:
        rows = block()
        images = table("id,camera,x,y,z,omega,phi,kappa", [*rows.images, rows.images[1]])
        found = wrong_block(tmp_path, images=images)
        assert found == ["images.csv:6: image 'no' is given twice (first in images.csv:3)"]

    def test_unknown_camera_is_told_once(self, tmp_path: Path) -> None:
        found = wrong_block(tmp_path, BLOCK.replace("  K:", "  k:"))
        assert found == ["images.csv:2: camera 'K' does not exist"]

    def test_unknown_end_of_a_sight(self, tmp_path: Path) -> None:
        found = wrong(tmp_path, "[B, C, 1.002", "[B, D, 1.002")
        assert found == ["project.yaml:9: to 'D' does not exist"]

    def test_unknown_instrument(self, tmp_path: Path) -> None:
        entry = "  - {type: distance, instrument: edm, columns: [from, to, distance, sigma], rows: [[A, B, 1, 1]]}"
        text = TRIANGLE.replace("observations:", "instruments: {edn: {offset: 0}}\nobservations:")
        found = mistakes(write(tmp_path, text + entry + "\n"))
        assert found == ["project.yaml:8: instrument 'edm' does not exist; did you mean 'edn'?"]

    def test_unknown_datum_point(self, tmp_path: Path) -> None:
        found = wrong_block(tmp_path, BLOCK.replace("datum: free", "datum: {free: [P1, P77]}"))
        assert found == ["project.yaml:13: datum point 'P77' does not exist; did you mean 'P7'?"]

    def test_unknown_observation_type(self, tmp_path: Path) -> None:
        found = wrong(tmp_path, "type: height_difference", "type: height_diference")
        assert found[0].startswith(
            "project.yaml:7: unknown observation type 'height_diference'; did you mean 'height_difference'? (known: "
        )


class TestStereoPairs:
    HEADER = "id,camera,x,y,z,omega,phi,kappa,leader,pair\n"
    TEXT = BLOCK.replace(
        "images:",
        "pairs:\n  - {columns: [id, bx, by, bz, omega, phi, kappa], rows: [[R, 1, 0, 0, 0, 0, 0]]}\nimages:",
    )

    def found(self, folder: Path, *images: str) -> list[str]:
        return wrong_block(folder, self.TEXT, images=self.HEADER + "\n".join(images) + "\n")

    def test_own_follower(self, tmp_path: Path) -> None:
        rows = ("010,K,,,,,,,010,R", "no,K,0,0,0,0,0,0,,", "1e3,K,0,0,0,0,0,0,,", "12:30,K,0,0,0,0,0,0,,")
        assert self.found(tmp_path, *rows) == [
            "images.csv:2: image '010' is its own leader; a stereo follower follows another image"
        ]

    def test_followers_of_each_other(self, tmp_path: Path) -> None:
        rows = ("010,K,,,,,,,no,R", "no,K,,,,,,,010,R", "1e3,K,0,0,0,0,0,0,,", "12:30,K,0,0,0,0,0,0,,")
        assert self.found(tmp_path, *rows) == [
            "images.csv:2: leader 'no' is itself a follower; a leader must be an image of its own",
            "images.csv:3: leader '010' is itself a follower; a leader must be an image of its own",
        ]

    def test_missing_references(self, tmp_path: Path) -> None:
        rows = ("010,K,0,0,0,0,0,0,,", "no,K,,,,,,,01,R", "1e3,K,,,,,,,010,Q", "12:30,K,,,,,,,,R")
        assert self.found(tmp_path, *rows) == [
            "images.csv:3: leader: image '01' does not exist; did you mean '010'?",
            "images.csv:4: pair 'Q' does not exist",
            "images.csv:5: image '12:30' has a pair but no leader; a stereo follower needs both",
        ]


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

    @pytest.mark.parametrize("rows", ["[[A, C, 10, 1]]", "[[A, C, 10, 1], [A, C, 10, 1]]"])
    def test_direction_set_with_one_target(self, tmp_path: Path, rows: str) -> None:
        entry = f"  - {{type: directions, columns: [station, to, horizontal, sigma], rows: {rows}}}"
        found = with_observations(tmp_path, entry)
        assert len(found) == 1
        assert found[0].startswith(
            "project.yaml:7: the set of directions at 'A' has a single horizontal target, expected two or more"
        )

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
        assert "zenith angles alone are of type zenith_angle" in found[0]

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
            ("[[1, 0, 0], [0, -1, 0], [0, 0, 1]]", "a variance is missing, zero or negative"),
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
        assert found[0].startswith(
            "project.yaml:9: dz: unit 'gon' does not fit a length (known: m, dm, cm, mm,"
        )

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
        entry = (
            "  - {type: parameter, columns: [of, component, value, sigma], rows: [[camera K, rx, 1, 0]]}\n"
        )
        found = wrong_block(tmp_path, BLOCK.replace("datum: free", entry + "datum: free"))
        assert found == ["project.yaml:13: camera K has no rx of its own: give it one where it is declared"]


class TestFeatures:
    def test_too_few_points(self, tmp_path: Path) -> None:
        text = TRIANGLE + "features: [{type: plane, id: wall, points: [A, B, C], sigma: 0.001}]\n"
        assert mistakes(write(tmp_path, text)) == [
            "project.yaml:7: a plane says nothing with 3 points; it needs 4 or more"
        ]

    def test_unknown_point(self, tmp_path: Path) -> None:
        text = TRIANGLE + "features: [{type: line, id: edge, points: [A, B, D, C], sigma: 0.001}]\n"
        assert mistakes(write(tmp_path, text)) == ["project.yaml:7: point 'D' does not exist"]


class TestTheFileItself:
    @pytest.mark.parametrize(
        ("text", "words"),
        [
            ("", "project.yaml:1: expected a mapping of keys and values"),
            ("- a\n", "project.yaml:1: expected a mapping of keys and values"),
            ("mor: 1\npoints: [\n", "project.yaml:3: this is not valid YAML"),
            ("mor: 1\npoints:\n\t- a\n", "project.yaml:3: this is not valid YAML"),
            ("mor: 1\n---\nmor: 1\n", "project.yaml:2: this is not valid YAML: expected a single document"),
            ("mor: 1\npoints: &a [*a]\n", "project.yaml:2: this is nested too deeply, or refers to itself"),
            ("mor: 1\n[a]: 2\n", "project.yaml:2: a key must be a plain text"),
            ("mor: \0\n", "project.yaml: this is not a text file of YAML"),
            ("title: x\n", "project.yaml:1: mor: this key is required"),
            ("mor: 2\n", "project.yaml:1: mor: found '2', expected '1'"),
        ],
    )
    def test_broken(self, tmp_path: Path, text: str, words: str) -> None:
        found = mistakes(write(tmp_path, text))
        assert found[0].startswith(words)

    def test_not_utf8(self, tmp_path: Path) -> None:
        project = write_block(tmp_path)
        project.write_bytes(BLOCK.replace("small", "schöner").encode("latin-1"))
        assert mistakes(project) == ["project.yaml: this is not UTF-8 text"]

    def test_table_not_utf8(self, tmp_path: Path) -> None:
        project = write_block(tmp_path)
        (tmp_path / "rays.csv").write_bytes("image,point,x,y\n010,P0,1,2\n010,Tür,1,2\n".encode("latin-1"))
        assert mistakes(project) == ["rays.csv:3: this is not UTF-8 text"]

    def test_damaged_archive(self, tmp_path: Path) -> None:
        project = write_block(tmp_path, BLOCK.replace("rays.csv", "rays.csv.gz"))
        (tmp_path / "rays.csv.gz").write_bytes(b"no gzip")
        found = mistakes(project)
        assert len(found) == 1
        assert found[0].startswith("rays.csv.gz: this file cannot be read: ")

    def test_damaged_parquet(self, tmp_path: Path) -> None:
        project = write_block(tmp_path, BLOCK.replace("rays.csv", "rays.parquet"))
        (tmp_path / "rays.parquet").write_bytes(b"no parquet at all")
        found = mistakes(project)
        assert len(found) == 1
        assert found[0].startswith("rays.parquet: this file cannot be read: ")

    def test_unknown_keys_have_their_nearest(self, tmp_path: Path) -> None:
        text = LEVELLING + "datums: free\nsettings: {max_iteration: 3}\n"
        found = mistakes(write(tmp_path, text))
        assert len(found) == 2
        assert found[0].startswith(
            "project.yaml:10: unknown key 'datums'; did you mean 'datum'? (known here: mor, title,"
        )
        assert found[1].startswith(
            "project.yaml:11: unknown key 'max_iteration'; did you mean 'max_iterations'?"
        )

    def test_unknown_keys_of_a_camera_and_of_a_value(self, tmp_path: Path) -> None:
        found = wrong_block(tmp_path, BLOCK.replace("{interior: {c: 20}}", "{interor: {c: 20}}"))
        assert any("unknown key 'interor'; did you mean 'interior'?" in line for line in found)
        found = wrong_block(tmp_path, BLOCK.replace("{c: 20}", "{c: {fre: 20}}"))
        assert any("unknown key 'fre'; did you mean 'free'?" in line for line in found)

    def test_value_that_is_nothing_it_may_be_is_told_once(self, tmp_path: Path) -> None:
        found = mistakes(write(tmp_path, LEVELLING + "datum: freee\n"))
        assert found == [
            "project.yaml:10: datum: found 'freee', expected 'fixed' or 'free'; did you mean 'free'?"
        ]
        found = mistakes(write(tmp_path, LEVELLING + "datum: {free: [A], fre: 1}\n"))
        assert len(found) == 1
        assert "unknown key 'fre'" in found[0]

    def test_all_that_a_value_may_be_is_told_together(self, tmp_path: Path) -> None:
        found = mistakes(
            write(tmp_path, LEVELLING + "stations: [{level: fix, columns: [id], rows: [[S]]}]\n")
        )
        assert found == [
            "project.yaml:10: stations → 1 → level: found 'fix', expected 'fixed' or 'free'; did you mean 'fixed'?, "
            "or a number, with or without a unit"
        ]


class TestAllMistakesAtOnce:
    def test_of_the_form(self, tmp_path: Path) -> None:
        text = LEVELLING.replace("units: {length: m}", "units: {length: meter}\ntitle: a\ntitle: b\naxis: {}")
        found = mistakes(write(tmp_path, text))
        assert [line.split(": ")[0] for line in found] == [
            "project.yaml:2",
            "project.yaml:4",
            "project.yaml:5",
        ]

    def test_of_the_content(self, tmp_path: Path) -> None:
        """Cameras, points, images and rays: four places, four mistakes, and none that only follows from another."""
        rows = block()
        found = wrong_block(
            tmp_path,
            BLOCK.replace("c: 20", "c: -20"),
            points=table("id,x,y,z", rows.points).replace("P3,", "P3,x"),
            images=table("id,camera,x,y,z,omega,phi,kappa", [*rows.images[:3], rows.images[2]]),
            rays=table("image,point,x,y", rows.rays).replace("010,P1,", "010,P1,one"),
        )
        assert len(found) == 4
        assert found[0] == "project.yaml:4: c: found -20, expected a camera constant > 0"
        assert found[1].startswith("points.csv:5: x: found 'x")
        assert found[2] == "images.csv:5: image '1e3' is given twice (first in images.csv:4)"
        assert found[3].startswith("rays.csv:3: x: found 'one")

    def test_names_are_checked_where_their_table_is_sound(self, tmp_path: Path) -> None:
        rows = block()
        found = wrong_block(
            tmp_path,
            points=table("id,x,y,z", rows.points).replace("P3,", "P3,x"),
            rays="image,point,x,y\n11,P0,1,2\n010,Q0,1,2\n",
        )
        assert [line.split(": ", 1)[1] for line in found[1:]] == ["image '11' does not exist"]
