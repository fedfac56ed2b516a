"""Every mistake in the input has words of its own: where it stands, what was found, what was expected."""

from __future__ import annotations

from pathlib import Path

import pytest

from tests.mistakes import TRIANGLE, mistakes, with_observations, wrong, wrong_block
from tests.scenarios.small_projects import BLOCK, LEVELLING, block, mor, table, write, write_block


def test_levelling_without_mistake_is_adjusted(tmp_path: Path) -> None:
    assert mor("adjust", write(tmp_path, LEVELLING)).code == 0


def test_missing_project_file(tmp_path: Path) -> None:
    run = mor("adjust", tmp_path / "nothing.yaml")
    assert (run.code, run.err) == (2, f"{tmp_path}/nothing.yaml: this file does not exist\n")


def test_folder_instead_of_project_file(tmp_path: Path) -> None:
    run = mor("adjust", tmp_path)
    assert run.code == 2
    assert run.err.startswith(f"{tmp_path}: ")
    assert "folder without a project file, expected" in run.err
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
        assert found == ["project.yaml:9: found σ = 0, expected σ > 0 (fix exact values instead of observing them)"]

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
        assert found[0].startswith("project.yaml:7: unknown column 'sigms'; did you mean 'sigma'? (known here: from,")

    def test_given_twice(self, tmp_path: Path) -> None:
        found = wrong(tmp_path, "columns: [from, to, dz, sigma]", "columns: [from, dz, dz, sigma]")
        assert any("column 'dz' is given twice" in line for line in found)

    def test_height_on_a_type_that_has_none(self, tmp_path: Path) -> None:
        entry = "  - {type: angle, columns: [at, from, to, angle, sigma, to_height], rows: [[A, B, C, 9, 1, 1.5]]}"
        assert with_observations(tmp_path, entry) == [
            "project.yaml:7: unknown column 'to_height' (known here: at, from, to, angle, "
            "sigma_angle, sigma, epoch, cluster)"
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
            "images.csv:2: leader 'no' is itself a follower; a leader must have its own position and attitude",
            "images.csv:3: leader '010' is itself a follower; a leader must have its own position and attitude",
        ]

    def test_missing_references(self, tmp_path: Path) -> None:
        rows = ("010,K,0,0,0,0,0,0,,", "no,K,,,,,,,01,R", "1e3,K,,,,,,,010,Q", "12:30,K,,,,,,,,R")
        assert self.found(tmp_path, *rows) == [
            "images.csv:3: leader: image '01' does not exist; did you mean '010'?",
            "images.csv:4: pair 'Q' does not exist",
            "images.csv:5: image '12:30' has a pair but no leader; a stereo follower needs both",
        ]


class TestTheFileItself:
    @pytest.mark.parametrize(
        ("text", "words"),
        [
            ("", "project.yaml:1: expected a mapping of keys and values"),
            ("- a\n", "project.yaml:1: expected a mapping of keys and values"),
            ("mor: 1\npoints: [\n", "project.yaml:3: this is not valid YAML"),
            ("mor: 1\npoints:\n\t- a\n", "project.yaml:3: this is not valid YAML"),
            (
                "mor: 1\n---\nmor: 1\n",
                "project.yaml:2: this is not valid YAML: a second document begins here",
            ),
            ("mor: 1\npoints: &a [*a]\n", "project.yaml:2: this is nested too deeply, or refers to itself"),
            ("mor: 1\n[a]: 2\n", "project.yaml:2: a key must be a plain text"),
            ("mor: \0\n", "project.yaml: this is not a text file of YAML"),
            ("title: x\n", "project.yaml:1: mor: this key is required"),
            (
                "defaults: {}\npoints: [{id: A}]\n",
                "project.yaml:1: this is YAML, but no project file, which has the key mor (mor: 1); "
                "found the keys defaults, points",
            ),
            ("mor: 2\n", "project.yaml:1: mor: found '2', expected '1'"),
        ],
    )
    def test_broken(self, tmp_path: Path, text: str, words: str) -> None:
        found = mistakes(write(tmp_path, text))
        assert found[0].startswith(words)

    def test_not_utf8(self, tmp_path: Path) -> None:
        project = write_block(tmp_path)
        project.write_bytes(BLOCK.replace("small", "schöner").encode("latin-1"))
        assert mistakes(project) == ["project.yaml:2: this is not UTF-8 text"]

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
        assert found[1].startswith("project.yaml:11: unknown key 'max_iteration'; did you mean 'max_iterations'?")

    def test_unknown_keys_of_a_camera_and_of_a_value(self, tmp_path: Path) -> None:
        found = wrong_block(tmp_path, BLOCK.replace("{interior: {c: 20}}", "{interor: {c: 20}}"))
        assert any("unknown key 'interor'; did you mean 'interior'?" in line for line in found)
        found = wrong_block(tmp_path, BLOCK.replace("{c: 20}", "{c: {fre: 20}}"))
        assert any("unknown key 'fre'; did you mean 'free'?" in line for line in found)

    def test_value_that_is_nothing_it_may_be_is_told_once(self, tmp_path: Path) -> None:
        found = mistakes(write(tmp_path, LEVELLING + "datum: freee\n"))
        assert found == ["project.yaml:10: datum: found 'freee', expected 'fixed' or 'free'; did you mean 'free'?"]
        found = mistakes(write(tmp_path, LEVELLING + "datum: {free: [A], fre: 1}\n"))
        assert len(found) == 1
        assert "unknown key 'fre'" in found[0]

    def test_all_that_a_value_may_be_is_told_together(self, tmp_path: Path) -> None:
        found = mistakes(write(tmp_path, LEVELLING + "stations: [{level: fix, columns: [id], rows: [[S]]}]\n"))
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


SECTIONS = (
    "title",
    "axes",
    "cameras",
    "images",
    "pairs",
    "stations",
    "systems",
    "features",
    "instruments",
    "checks",
)


def test_a_key_with_nothing_behind_it_is_as_if_it_were_not_there(tmp_path: Path) -> None:
    """Also in the adjusted project, and with keys of sections left empty."""
    empty = "".join(f"{name}:\n" for name in SECTIONS) + "datum:\nsettings: {sigma0: , robust: }\n"
    project = write(tmp_path, LEVELLING.replace("units: {length: m}", "units: {length: m, angle: }") + empty)
    assert mor("adjust", project, "--snoop").code == 0
    assert mor("adjust", tmp_path / "project.results" / "adjusted.yaml").code == 0
    plain = mor("adjust", write(tmp_path / "plain", LEVELLING), "--snoop")
    assert plain.code == 0
    tables = [(folder / "project.results" / "points.csv").read_text() for folder in (tmp_path, tmp_path / "plain")]
    assert tables[0] == tables[1]


def test_a_required_key_with_nothing_behind_it(tmp_path: Path) -> None:
    assert wrong(tmp_path, "mor: 1", "mor:") == ["project.yaml:1: mor: this key is required"]
    found = wrong(tmp_path, "type: height_difference", "type:")
    assert found == ["project.yaml:7: observations → 1 → type: this key is required"]


@pytest.mark.parametrize(
    ("old", "new", "words"),
    [
        ("units: {length: m}", "units: m", "2: units: found 'm', expected keys and values"),
        ("units: {length: m}", "settings: [1]", "2: settings: found a list, expected keys and values"),
        ("units: {length: m}", "cameras: {N: }", "2: cameras → N: found nothing, expected keys and values"),
        (
            "units: {length: m}",
            "cameras: {N: {interior: {c: }}}",
            "2: cameras → N → interior → c: found nothing, expected a single value, or keys and values",
        ),
        ("units: {length: m}", "title: [a]", "2: title: found a list, expected a single value"),
        (
            "units: {length: m}",
            "datum: [A]",
            "2: datum: found a list, expected 'fixed' or 'free', or keys and values",
        ),
        (
            "units: {length: m}",
            "datum: {minimal: {z: }}",
            "2: datum → minimal → z: found nothing, expected a single value, or a list",
        ),
        (
            "units: {length: m}",
            "datum: {free: [A], minimal: {z: A}}",
            "2: datum: give either free or minimal",
        ),
        (
            "units: {length: m}",
            "settings: {max_iterations: many}",
            "2: settings → max_iterations: found 'many', expected a whole number",
        ),
        (
            "units: {length: m}",
            "settings: {max_iterations: 0}",
            "2: settings → max_iterations: found '0', expected 1 or more",
        ),
        (
            "units: {length: m}",
            "settings: {global_level: 2}",
            "2: settings → global_level: found '2', expected a number below 1",
        ),
        (
            "units: {length: m}",
            "settings: {snooping: maybe}",
            "2: settings → snooping: found 'maybe', expected true or false",
        ),
        ("[[A, 0, 0, 10]]", "A", "4: points → 1 → rows: found 'A', expected a list"),
        (
            "[A, 0, 0, 10]",
            "[A, [0], 0, 10]",
            "4: points → 1 → rows → 1 → 2: found a list, expected a single value",
        ),
        ("fixed: [x, y]", "fixed: x", "5: points → 2 → fixed: found 'x', expected a list"),
        (
            "rows: [[A, 0",
            "delimiter: ab, rows: [[A, 0",
            "4: points → 1 → delimiter: found 'ab', expected a single character",
        ),
        (
            "type: height_difference",
            "factor: 0",
            "7: observations → 1 → factor: found '0', expected a number above 0",
        ),
    ],
)
def test_another_kind_of_value(tmp_path: Path, old: str, new: str, words: str) -> None:
    assert f"project.yaml:{words}" in wrong(tmp_path, old, new)


@pytest.mark.parametrize(
    ("text", "line", "words"),
    [
        ("\ttitle: a\n", 10, "indent with blanks, not with tabs"),
        ('title: "a\n', 10, "the quote that opens here is not closed"),
        ("datum: {free: [A, B}\n", 10, "the bracket that opens here is not closed"),
        ("title: *a\n", 10, "texts that begin with * need quotes"),
        ("title: a: b\n", 10, "texts with ': ' need quotes"),
        ("settings\n", 10, "expected key: value, found no colon"),
        ("  title: a\n", 10, "the indentation does not fit the lines above"),
        ("---\nmor: 1\n", 10, "a second document begins here"),
    ],
)
def test_broken_yaml_is_told_in_plain_words(tmp_path: Path, text: str, line: int, words: str) -> None:
    run = mor("check", write(tmp_path, LEVELLING + text))
    assert run.code == 2
    assert run.err.startswith(f"{tmp_path}/project.yaml:{line}: this is not valid YAML: ")
    assert words in run.err


def test_a_unit_that_does_not_fit_is_told_once(tmp_path: Path) -> None:
    """Where it stands, not with every row."""
    found = wrong(tmp_path, "columns: [from, to, dz, sigma]", "units: {dz: gon}\n    columns: [from, to, dz, sigma]")
    assert found == [
        "project.yaml:8: column dz: unit 'gon' does not fit a length "
        "(known: m, dm, cm, mm, um, µm, μm, km, ft, us-ft, in)"
    ]


def test_a_number_beyond_all_numbers(tmp_path: Path) -> None:
    found = wrong(tmp_path, "1.002", "1e400")
    assert found == ["project.yaml:9: dz: found '1e400', expected a finite number"]


def test_one_column_is_one_column(tmp_path: Path) -> None:
    assert wrong(tmp_path, "[A, 0, 0, 10]", "[A]") == ["project.yaml:4: found 1 column, expected 4 (id, x, y, z)"]
