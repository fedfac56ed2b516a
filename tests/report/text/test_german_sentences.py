"""Not determined, in German: whole sentences, as a user meets them."""

from __future__ import annotations

from pathlib import Path

from tests.scenarios.small_projects import BLOCK, LEVELLING, block, mor, write, write_block

NO_DATUM = BLOCK.replace("datum: free\n", "")


def test_an_open_datum(tmp_path: Path) -> None:
    run = mor("adjust", write_block(tmp_path, NO_DATUM), "--lang", "de")
    assert run.code == 4
    assert "KEINE LÖSUNG: singulär, das Datum ist nicht festgelegt." in run.err
    assert "Die Beobachtungen lassen 7 Bewegungen des ganzen Netzes offen: Translation X, " in run.err
    assert "oder datum: free schreiben für ein freies Netz." in run.err
    assert run.err.splitlines()[0] in (tmp_path / "project.results" / "report.txt").read_text(encoding="utf-8")


def test_an_image_with_two_points(tmp_path: Path) -> None:
    rows = block(noise=0.002)
    rays = [ray for ray in rows.rays if ray[0] != "no" or ray[1] in ("P3", "P7")]
    run = mor("adjust", write_block(tmp_path, BLOCK, rows._replace(rays=rays)), "--lang", "de")
    assert "Bild no sieht nur zwei Punkte, P3, P7: Drehung um deren Gerade möglich" in run.err


def test_parts_that_nothing_connects(tmp_path: Path) -> None:
    apart = """\
points:
  - {columns: [id, x, y, z], rows: [[D, 0, 0, 1.5], [E, 0, 0, 2.5]], fixed: [x, y]}
  - {columns: [id, x, y, z], rows: [[A, 0, 0, 10]], fixed: [x, y, z]}
"""
    text = LEVELLING.replace("points:\n  - {columns: [id, x, y, z], rows: [[A, 0, 0, 10]], fixed: [x, y, z]}\n", apart)
    text = text.replace("[C, A, -2.001, 0.001]", "[C, A, -2.001, 0.001], [D, E, 1.0, 0.001]")
    german, english = (mor("adjust", write(tmp_path / lang, text), "--lang", lang).err for lang in ("de", "en"))
    assert "The network falls into 2 parts" in english
    assert "Das Netz zerfällt in 2 Teile, die keine Beobachtung verbindet:" in german
    assert "  Teil 2: Punkte D, E" in german
