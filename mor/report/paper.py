"""The report on paper: a PDF of a few pages that can be signed, with appendices on request."""

from __future__ import annotations

from collections.abc import Callable, Collection, Iterable, Sequence
from io import BytesIO
from pathlib import Path
from typing import Any

import polars as pl
import yaml

from mor.errors import InputError, Message, escaped, shortened
from mor.report.language import Words
from mor.report.layout import DIGITS, cells, in_words, persons, probability, sigma_decimals, small_unit
from mor.report.page import agreement, cameras_of_page, determination, judgements, sigma_words
from mor.report.page_data import PageData, control_table, deviations_of_points, page_data
from mor.report.plots import ellipses, spell_out, style
from mor.report.verdict import said_conventions, uncontrolled_in_words
from mor.report.view import View

MOST_ROWS = 40
"""Rows of every other table."""
_WIDTH, _HEIGHT, _DOTS = 7.5, 4.1, 200
"""Size of the figure in inches, and its dots per inch."""


class Writer:
    """Collects headings, paragraphs and tables and lays them out on sheets.

    Raises :class:`InputError` if reportlab or Matplotlib is missing.
    """

    def __init__(self, head: str, paper: str, words: Words, right: str = ""):
        try:
            from reportlab.lib import pagesizes
        except ImportError:
            wanted = "a PDF needs the Python packages reportlab and matplotlib: pip install 'mor-adjustment[plot]'"
            raise InputError([Message(wanted)]) from None
        self.words, self._head, self._right = words, shortened(escaped(head), 70), right
        self.size: tuple[float, float] = pagesizes.A4 if paper == "A4" else pagesizes.LETTER
        self._margin = 45.0
        self.width = self.size[0] - 2.0 * self._margin
        self._story: list[Any] = []
        _load_fonts()

    def heading(self, text: str, level: int = 2, room: float = 80.0) -> None:
        """Add a heading, on a new sheet if less than ``room`` points are left for what follows."""
        from reportlab.platypus import CondPageBreak

        size = {1: 15.0, 2: 11.0, 3: 8.5}[level]
        self._story.append(CondPageBreak(room))
        self._add(text, "mor-Bold", size, before=11.0 if level < 3 else 6.0, after=3.0)

    def text(self, text: str, bold: bool = False) -> None:
        """Add a paragraph."""
        self._add(text, "mor-Bold" if bold else "mor", 8.5, after=3.0)

    def note(self, text: str) -> None:
        """Add a paragraph in small type."""
        self._add(text, "mor", 7.0, after=3.0)

    def _add(self, text: str, font: str, size: float, before: float = 0.0, after: float = 0.0) -> None:
        from reportlab.platypus import Paragraph

        if text:
            self._story.append(Paragraph(_marked(text), self._look(font, size, before, after)))

    def _look(self, font: str, size: float, before: float = 0.0, after: float = 0.0) -> Any:
        from reportlab.lib.styles import ParagraphStyle

        return ParagraphStyle(
            font,
            fontName=font,
            fontSize=size,
            leading=1.25 * size,
            spaceBefore=before,
            spaceAfter=after,
            splitLongWords=0,
            allowWidows=0,
            allowOrphans=0,
        )

    def table(
        self,
        headers: Iterable[str],
        rows: Sequence[Sequence[str]],
        left: int = 1,
        bold: Collection[int] = (),
        most: int | None = None,
    ) -> None:
        """Add a table of finished cells: ``left`` columns of texts, and the numbers of the rows in bold type.

        Cells are wrapped between words only; a table that is too wide gets smaller letters. Of more than ``most`` rows
        the rest is counted.
        """
        from reportlab.lib.colors import HexColor
        from reportlab.pdfbase.pdfmetrics import stringWidth
        from reportlab.platypus import LongTable, Paragraph, Spacer

        if not rows:
            return
        head, shown = list(headers), rows[:most]
        columns = [k for k in range(len(head)) if any(row[k] for row in shown)]
        left = sum(k < left for k in columns)
        lines = [
            [" ".join(shortened(word, 36 + 28) for word in escaped(row[k]).split(" ") if word) for k in columns]
            for row in (head, *shown)
        ]
        for line in lines[1:]:
            line[left:] = [text.replace(" ", "\u00a0") for text in line[left:]]
        size, gap = 7.75, 7.0
        while True:
            whole, least = (
                [max(column) for column in zip(*rows, strict=True)] for rows in _extents(lines, size, stringWidth)
            )
            room = self.width - gap * len(columns)
            # Sizes of the letters of tables, points.
            if sum(least) <= room or size <= 5.0:
                break
            size -= 0.25
        widths = _shared(whole, least, room)
        cells: list[list[Any]] = []
        for number, line in enumerate(lines):
            font = "mor-Bold" if number == 0 or number - 1 in bold else "mor"
            row: list[Any] = []
            for k, text in enumerate(line):
                if stringWidth(text, font, size) <= widths[k] + 0.1:
                    row.append(text)
                    continue
                look = self._look(font, size)
                look.alignment = 0 if k < left else 2
                row.append(Paragraph(_marked(text), look))
            cells.append(row)
        drawn = LongTable(cells, [width + gap for width in widths], repeatRows=1, hAlign="LEFT")
        commands: list[Any] = [
            ("FONT", (0, 0), (-1, -1), "mor", size, 1.2 * size),
            ("FONT", (0, 0), (-1, 0), "mor-Bold", size, 1.2 * size),
            ("ALIGN", (0, 0), (left - 1, -1), "LEFT"),
            ("ALIGN", (left, 0), (-1, -1), "RIGHT"),
            ("VALIGN", (0, 0), (-1, 0), "BOTTOM"),
            ("VALIGN", (0, 1), (-1, -1), "TOP"),
            ("LEFTPADDING", (0, 0), (-1, -1), 0.0),
            ("RIGHTPADDING", (0, 0), (-1, -1), gap),
            ("TOPPADDING", (0, 0), (-1, -1), 1.2),
            ("BOTTOMPADDING", (0, 0), (-1, -1), 1.2),
            ("LINEBELOW", (0, 0), (-1, 0), 0.6, HexColor("#444444")),
            ("LINEBELOW", (0, 1), (-1, -1), 0.2, HexColor("#cccccc")),
            *(("FONT", (0, k + 1), (-1, k + 1), "mor-Bold", size, 1.2 * size) for k in bold),
        ]
        if left == 0:
            commands.pop(2)
        drawn.setStyle(commands)
        self._story += [drawn, Spacer(1.0, 5.0)]
        if len(shown) < len(rows):
            self.note(self.words("{count:more is|more are} in the results.", count=len(rows) - len(shown)))

    def facts(self, rows: Iterable[tuple[str, str]]) -> None:
        """Add a table of names and values without a heading."""
        from reportlab.platypus import Paragraph, Table

        cells = [[Paragraph(_marked(text), self._look("mor", 8.0)) for text in row] for row in rows]
        if cells:
            table = Table(cells, [0.3 * self.width, 0.7 * self.width], hAlign="LEFT")
            table.setStyle(
                [
                    ("VALIGN", (0, 0), (-1, -1), "TOP"),
                    ("LEFTPADDING", (0, 0), (-1, -1), 0.0),
                    ("TOPPADDING", (0, 0), (-1, -1), 0.5),
                    ("BOTTOMPADDING", (0, 0), (-1, -1), 1.0),
                ]
            )
            self._story.append(table)

    def picture(self, figure: Any) -> None:
        """Add a Matplotlib figure as wide as the text."""
        from reportlab.platypus import Image

        buffer, (wide, high) = BytesIO(), figure.get_size_inches()
        spell_out(figure)
        figure.savefig(buffer, format="png", dpi=_DOTS, metadata={"Software": "mor"})
        buffer.seek(0)
        self._story.append(Image(buffer, self.width, self.width * high / wide))

    def signature(self) -> None:
        """Add the lines for place, date and signature."""
        from reportlab.platypus import KeepTogether, Spacer, Table

        table = Table(
            [[self.words("place and date"), "", self.words("signature")]],
            [0.45 * self.width, 0.1 * self.width, 0.45 * self.width],
        )
        table.setStyle(
            [
                ("FONT", (0, 0), (-1, -1), "mor", 8.0),
                ("LINEABOVE", (0, 0), (0, 0), 0.6, "black"),
                ("LINEABOVE", (2, 0), (2, 0), 0.6, "black"),
            ]
        )
        self._story.append(KeepTogether([Spacer(1.0, 50.0), table]))

    def new_page(self) -> None:
        """Continue on a new sheet."""
        from reportlab.platypus import PageBreak

        self._story.append(PageBreak())

    def write(self, target: Path) -> None:
        """Write the PDF: same content, same bytes."""
        from reportlab.pdfgen.canvas import Canvas
        from reportlab.platypus import SimpleDocTemplate

        outer = self

        class Numbered(Canvas):  # type: ignore[misc]
            """A canvas that knows the number of pages when it writes their heads."""

            def __init__(self, *given: Any, **named: Any):
                super().__init__(*given, **named)
                self.sheets: list[dict[str, Any]] = []

            def showPage(self) -> None:  # noqa: N802 - the name of the canvas
                self.sheets.append(dict(self.__dict__))
                self._startPage()

            def save(self) -> None:
                sheets = self.sheets
                for number, sheet in enumerate(sheets, 1):
                    self.__dict__.update(sheet)
                    outer.running(self, number, len(sheets))
                    super().showPage()
                super().save()

        document = SimpleDocTemplate(
            str(target),
            pagesize=self.size,
            leftMargin=self._margin - 6.0,
            rightMargin=self._margin - 6.0,
            topMargin=52.0,
            bottomMargin=45.0,
            title=self._head,
            author="",
            creator="mor",
            invariant=1,
        )
        document.build(self._story, canvasmaker=Numbered)

    def running(self, canvas: Any, number: int, count: int) -> None:
        """Draw the project above, the number of the page below."""
        canvas.setFont("mor", 7.0)
        canvas.setFillGray(0.27)
        top = self.size[1] - 34.0
        canvas.drawString(self._margin, top, self._head)
        canvas.drawRightString(self.size[0] - self._margin, top, self._right)
        below = f"{self.words('page')} {number} / {count}"
        canvas.drawRightString(self.size[0] - self._margin, 28.0, below)


def _load_fonts() -> None:
    from reportlab.pdfbase.pdfmetrics import getRegisteredFontNames, registerFont
    from reportlab.pdfbase.ttfonts import TTFont

    if "mor" in getRegisteredFontNames():
        return
    with style():
        from matplotlib import get_data_path
    for suffix, file in {"": "DejaVuSans.ttf", "-Bold": "DejaVuSans-Bold.ttf"}.items():
        registerFont(TTFont(f"mor{suffix}", str(Path(get_data_path()) / "fonts" / "ttf" / file)))


def _marked(text: str) -> str:
    return escaped(text).replace("&", "&amp;").replace("<", "&lt;").replace(">", "&gt;")


def _extents(
    lines: list[list[str]], size: float, width: Callable[[str, str, float], float]
) -> tuple[list[list[float]], list[list[float]]]:
    whole = [[width(cell, "mor-Bold", size) for cell in line] for line in lines]
    words = [
        [max((width(word, "mor-Bold", size) for word in cell.split(" ")), default=0.0) for cell in line]
        for line in lines
    ]
    return whole, words


def _shared(whole: Sequence[float], least: Sequence[float], room: float) -> list[float]:
    spare, wanted = room - sum(least), sum(whole) - sum(least)
    share = 1.0 if wanted <= spare else max(spare, 0.0) / wanted
    return [low + share * (high - low) for low, high in zip(least, whole, strict=True)]


# ---- The sections of the report.


def report_on_paper(view: View, folder: Path, appendices: Sequence[str], paper: str, words: Words) -> Writer:
    """Return the report of results that stand in ``folder``. Raises :class:`InputError` for an unknown appendix."""
    found = {
        "residuals": view.residuals.height,
        "images": view.images.height,
        "covariances": view.points.height,
    }
    known = [name for name, count in found.items() if count]
    for name in appendices:
        if name not in known:
            raise InputError([Message(f"no appendix {name!r} of these results (known: {', '.join(known)})")])
    title = view.summary["title"] or words("Adjustment")
    right = " · ".join(part for part in (view.identity["date"], view.identity["program"]) if part)
    to, data = Writer(title, paper, words, right), page_data(view, words)
    to.heading(title, 1)
    for section in (_identity, _verdict, _figure, _adjusted):
        section(to, data)
    _datum(to, data, folder)
    for section in (_cameras, _control, _movements, _weakest, _flagged, _points, _inputs):
        section(to, data)
    to.signature()
    for name in appendices:
        to.new_page()
        to.heading(words("Appendix: {name}", name=words(name)))
        {"residuals": _residuals, "images": _images, "covariances": _covariances}[name](to, data)
    return to


def _identity(to: Writer, data: PageData) -> None:
    say, view = data.words, data.view
    units = view.summary["units"]
    said = say("lengths in {length}, angles in {angle}", **units) + "; " + say("residual v = adjusted − observed")
    rows = [*persons(view.identity, say), (say("program"), view.identity["program"])]
    rows += [(say("options"), " ".join(view.identity["options"]) or say("none")), (say("units"), said)]
    to.facts(rows)


def _verdict(to: Writer, data: PageData) -> None:
    say, summary = data.words, data.view.summary
    to.heading(say("Verdict"))
    for name, part in ((say("Agreement"), agreement(data)), (say("Determination"), determination(data))):
        to.text(f"{name}: {part.title}", bold=True)
        to.text(part.words)
    test, sigma0 = summary["global_test"], summary["sigma0"]
    names = ["observations n", "unknowns u", "datum defect d", "redundancy n − u + d"]
    names += ["σ0 a priori [1]", "σ0 a posteriori [1]", "vᵀPv"]
    values = _cells(summary, "observations unknowns defect redundancy") + _cells(sigma0, "apriori:.6g aposteriori:.6g")
    values.append(f"{test['statistic']:.1f} ({test['lower']:.1f} … {test['upper']:.1f})")
    to.facts(zip(map(say, names), values, strict=True))
    to.heading(say("Judgements"), 3)
    signs = {"good": "✓", "doubt": "!", "bad": "✗", "plain": "·"}
    to.table(map(say, ("judged", "result")), [(x.title, f"{signs[x.state]} {x.words}") for x in judgements(data)], 2)


def _figure(to: Writer, data: PageData) -> None:
    if not data.view.points.height:
        return
    to.heading(data.words("Network"), room=to.width * _HEIGHT / _WIDTH + 35.0)
    with style():
        to.picture(ellipses(data.view, data.words, size=(_WIDTH, _HEIGHT), effects=False))


def _adjusted(to: Writer, data: PageData) -> None:
    """Groups with their σ a priori, where these come from, and what became of them."""
    say, view = data.words, data.view
    to.heading(say("Summary of the adjustment"))
    counts = (
        (view.points.height, "{count:point|points}"),
        (view.images.height, "{count:image|images}"),
        (view.stations.height, "{count:station|stations}"),
        (len(view.cameras), "{count:camera|cameras}"),
    )
    to.text(", ".join(say(text, count=count) for count, text in counts if count) + ".")
    sigmas = (
        view.residuals.filter(pl.col("sigma").is_not_null())
        .group_by("group", "type", "component", "unit", maintain_order=True)
        .agg(pl.len().alias("n"), pl.col("sigma").min().alias("low"), pl.col("sigma").max().alias("high"))
    )
    rows = []
    for row in sigmas.to_dicts():
        low, high = f"{row['low']:.3g}", f"{row['high']:.3g}"
        how = "" if row["n"] == 1 else say("one value for all") if low == high else say("one for each observation")
        said = low if low == high else f"{low} … {high}"
        rows.append((*_cells(row, "group type component"), how, *_cells(row, "unit n"), said))
    to.heading(say("Standard deviations a priori"), 3)
    headers = ("group", "type", "component", "given as", "unit", "n", "σ")
    to.table(map(say, headers), rows, 5, most=MOST_ROWS)
    judged = {
        (row["name"], row["observations"]): row
        for row in (view.verdict or {}).get("groups", [])
        if row["of"] == "group"
    }
    table, bold = [], []
    for k, row in enumerate(view.groups.to_dicts()):
        test, result = judged.get((row["name"], row["observations"])), "–"
        if test is not None:
            result = f"{say('rejected') if test['rejected'] else say('accepted')} (p\u00a0=\u00a0{test['p']:.2g})"
            bold += [k] if test["rejected"] and k < MOST_ROWS else []
        numbers = _cells(row, "observations redundancy:.1f sigma0:.3f largest_w:.2f flagged")
        table.append((row["name"], row["type"], result, *numbers))
    components = view.summary.get("variance_components") or {}
    to.note(
        say("The standard deviations are variance components estimated from the residuals.")
        if components.get("iterated")
        else say("The project gives these standard deviations; the tests of the groups judge them.")
    )
    to.heading(say("Observation groups"), 3)
    columns = ("group", "type", "test", "n", "Σ r", "σ0 of the group [1]", "largest |w| [1]", "flagged")
    to.table(map(say, columns), table, 3, bold, MOST_ROWS)


def _datum(to: Writer, data: PageData, folder: Path) -> None:
    say, view = data.words, data.view
    to.heading(say("Datum"))
    named = say("{datum}. Coordinates and σ refer to it.", datum=data.datum)
    to.text(named[:1].upper() + named[1:])
    for line in said_conventions(view.verdict, say) if view.verdict else ():
        to.text(line)
    declared = _declared_datum(folder)
    if declared:
        to.text(say("The project declares: {datum}", datum=declared))
    rows: dict[tuple[str, str, str], list[str]] = {}
    for row in control_table(view).to_dicts():
        if row["sigma"]:
            key = (row["point"], say("observed"), f"{row['sigma']:.3g} {row['unit']}")
            rows.setdefault(key, []).append(row["component"].upper())
    for row in view.points.filter(pl.col("status").is_in(["fixed", "partly fixed"])).to_dicts():
        rows[(str(row["id"]), say("fixed"), "–")] = [axis.upper() for axis in "xyz" if not row[f"s{axis}"]]
    listed = [
        (point, "".join(dict.fromkeys(components)), how, sigma) for (point, how, sigma), components in rows.items()
    ]
    if listed:
        to.text(say("These coordinates hold the datum:"))
    to.table(map(say, ("point", "components", "held as", "σ given")), listed, 3, most=MOST_ROWS)


def _declared_datum(folder: Path) -> str:
    path = folder / "adjusted.yaml"
    if not path.is_file():
        return ""
    declared = (yaml.safe_load(path.read_text(encoding="utf-8")) or {}).get("datum")
    return (
        yaml.safe_dump(declared, default_flow_style=True, allow_unicode=True, width=10_000).replace("...", "").strip()
        if declared
        else ""
    )


def _cameras(to: Writer, data: PageData) -> None:
    say = data.words
    if not data.view.cameras:
        return
    to.heading(say("Cameras"))
    for camera in cameras_of_page(data.view):
        to.heading(say("Camera {id} – model {model}", id=camera["id"], model=camera["model"]), 3)
        rows = [
            (row["name"], say(row["meaning"]) if row["meaning"] else "", say(row["status"]),
             *_cells(row, "unit value:.8g sigma:.3g t:.1f"), probability(row["p"]))
            for row in camera["rows"]
            if row["sigma"] or row["value"]
        ]  # fmt: skip
        to.table(map(say, ("name", "meaning", "status", "unit", "value", "σ", "|t|", "p")), rows, 4)


def _control(to: Writer, data: PageData) -> None:
    say, view, control = data.words, data.view, control_table(data.view)
    parts = [(kind, row) for kind, rows in deviations_of_points(view) for row in rows]
    if not (parts or control.height or view.checks):
        return
    to.heading(say("Control and checks"))
    sizes = ("component", "unit", "n", "mean", "rms", "largest")
    to.table(map(say, ("points", *sizes)), [(say(kind), *_deviation(row)) for kind, row in parts], 3)
    rows = [(row["point"], row["component"].upper(), *_residual(row, say)) for row in control.to_dicts()]
    headers = ("point", "component", "flag", "unit", "given", "v", "σ", "r [1]", "w [1]")
    to.table(map(say, headers), rows, 4, most=MOST_ROWS)
    checks = [(row["group"], *_deviation(row), *_cells(row, "exceeding:.0f")) for row in view.checks[:MOST_ROWS]]
    to.table(map(say, ("checks", *sizes, "beyond test")), checks, 3)


def _deviation(row: dict[str, Any]) -> list[str]:
    form = f".{DIGITS[row['unit']]}f" if row["unit"] in DIGITS else ".3g"
    return _cells(row, f"component unit count:.0f mean:{form} rms:{form} largest:{form}")


def _movements(to: Writer, data: PageData) -> None:
    say, frame = data.words, data.view.movements
    if not frame.height:
        return
    last = frame.group_by("point", maintain_order=True).last().sort("p", nulls_last=True, maintain_order=True)
    sizes = [abs(value) for axis in "xyz" for value in last[axis].drop_nulls()]
    unit, factor = small_unit(data.view.length, max(sizes, default=1.0))
    places = sigma_decimals(last.select("sx", "sy", "sz").drop_nulls().to_numpy().ravel() * factor)
    to.heading(say("Movements from the first to the last epoch"))
    to.text(say("{count:point has|points have} moved, of {all}", count=int(last["moved"].sum()), all=last.height) + ".")
    sized = last.with_columns(pl.col("x", "y", "z", "sx", "sy", "sz") * factor)
    rows = [
        (
            *_cells(row, "point from to"),
            say("moved") if row["moved"] else "–",
            *_cells(row, " ".join(f"{name}:.{places}f" for name in ("x", "y", "z", "sx", "sy", "sz"))),
            *_cells(row, "test:.2f"),
            probability(row["p"]),
        )
        for row in sized.to_dicts()
    ]
    axes = (f"{s}{axis} [{unit}]" for s in ("Δ", "σΔ") for axis in "XYZ")
    moved = [k for k, row in enumerate(last["moved"][:MOST_ROWS]) if row]
    to.table(map(say, ("point", "from", "to", "result", *axes, "test", "p")), rows, 4, moved, MOST_ROWS)


def _weakest(to: Writer, data: PageData) -> None:
    say, view = data.words, data.view
    to.heading(say("Weakest spots"))
    known = data.points.filter(pl.col("ellipsoid_a").is_not_null())
    if known.height:
        worst = known.sort("ellipsoid_a", descending=True, maintain_order=True).head(5)
        unit, factor = small_unit(view.length, worst["ellipsoid_a"][0])
        worst = worst.with_columns(pl.col("ellipsoid_a") * factor)
        to.heading(say("Least precise points"), 3)
        rows = [_cells(row, "id ellipsoid_a:.3g rays others") for row in worst.to_dicts()]
        to.table((say("point"), f"{say('ellipsoid a')} [{unit}]", say("rays"), say("others")), rows)
    if view.reliability is None:
        return
    for line in uncontrolled_in_words(view.reliability, say):
        to.text(line)
    controlled = []
    for key, kind in (("points", "point"), ("images", "image"), ("stations", "station")):
        for row in sorted(view.reliability[key], key=lambda row: float(row["smallest_r"]))[:4]:
            names = (say(kind), row["id"], in_words(row["weakest"], say), row["weakest"]["unit"])
            controlled.append((*names, *_cells(row, "smallest_r:.2f nabla:.3g shift:.3g")))
    to.heading(say("Least controlled"), 3)
    numbers = ("observation", "unit", "smallest r", "∇", f"{say('effect')} [{view.length}]")
    to.table((say("weakest"), say("id"), *map(say, numbers)), controlled, 4)


def _flagged(to: Writer, data: PageData) -> None:
    say, gross = data.words, data.view.gross_errors
    flagged = [row for row in gross.get("suspicious", []) if row["flagged"]]
    out = data.view.residuals.filter(pl.col("flag") == "excluded")
    to.heading(say("Flagged observations"))
    if not flagged and not out.height:
        to.text(say("No observation is flagged."))
    rows = [(in_words(row, say), *_cells(row, "unit w:.2f r:.3f error:.3g nabla:.3g")) for row in flagged]
    headers = ("observation", "unit", "w [1]", "r [1]", "estimated error", "∇ smallest detectable")
    to.table(map(say, headers), rows, 2, most=MOST_ROWS)
    if out.height:
        to.heading(say("Excluded from the adjustment"), 3)
        _observations(to, out, say, MOST_ROWS)


def _points(to: Writer, data: PageData) -> None:
    say, view, points = data.words, data.view, data.points
    if not points.height:
        return
    to.heading(say("Points"))
    # Points that are listed; of more, the least precise ones.
    most_points = 150
    if points.height > most_points:
        said = "The {count} least precise of {all} points; the table of points has all of them."
        to.text(say(said, count=most_points, all=points.height))
        points = points.sort("ellipsoid_a", descending=True, nulls_last=True, maintain_order=True).head(most_points)
    sigma = points.select("sx", "sy", "sz").drop_nulls().to_numpy().ravel()
    places = sigma_decimals(sigma[sigma > 0.0]) if (sigma > 0.0).any() else 4
    unit, factor = small_unit(view.length, float(sigma.max(initial=0.0)) or 1.0)
    fine = sigma_decimals(sigma[sigma > 0.0] * factor) if (sigma > 0.0).any() else 2
    small = ("sx", "sy", "sz", "ellipse_a", "ellipse_b")
    points = points.with_columns(pl.col(small) * factor, (pl.col("rays") + pl.col("others")).alias("n"))
    numbers = " ".join([*(f"{axis}:.{places}f" for axis in "xyz"), *(f"{name}:.{fine}f" for name in small)])
    rows = [
        (str(row["id"]), say(row["status"]), *_cells(row, f"{numbers} ellipse_azimuth:.1f n"))
        for row in points.to_dicts()
    ]
    headers = ("point", "status", *(f"{axis} [{view.length}]" for axis in "XYZ"))
    sigmas = (f"{name} [{unit}]" for name in ("σX", "σY", "σZ", "a", "b"))
    azimuth = f"{say('azimuth of a')} [{view.summary['units']['angle']}]"
    to.table((*map(say, headers), *sigmas, azimuth, "n"), rows, 2)
    to.note(
        f"{sigma_words(data)}. "
        + say("a, b: semi-axes of the standard ellipse in plan; n: rays and other observations of the point.")
    )


def _inputs(to: Writer, data: PageData) -> None:
    say, view = data.words, data.view
    files = view.identity["inputs"]
    together = 13.0 * (len(files) + 2 * len(view.notes)) + 150.0
    to.heading(say("Inputs"), room=min(together, 0.5 * to.size[1]))
    to.table(map(say, ("file", "SHA-256", "bytes")), [_cells(f, "file sha256 bytes") for f in files], 2, most=MOST_ROWS)
    if view.notes:
        to.heading(say("Notes on what was read"), 3)
        rows = [
            (f"{row['file']}:{row['line']}" if row["line"] else row["file"] or "", say.told(row["message"]))
            for row in view.notes
        ]
        to.table(map(say, ("file", "note")), rows, 2, most=MOST_ROWS)


# ---- Appendices.


def _residuals(to: Writer, data: PageData) -> None:
    _observations(to, data.view.residuals, data.words)


def _observations(to: Writer, frame: pl.DataFrame, say: Words, most: int | None = None) -> None:
    rows = []
    for row in frame.iter_rows(named=True):
        ends = " – ".join(part for part in (row["at"], row["from"], row["to"]) if part)
        rows.append((row["type"], ends, row["component"], *_residual(row, say)))
    bold = [k for k, flag in enumerate(frame["flag"][:most]) if flag]
    headers = ("type", "between", "component", "flag", "unit", "observed", "v", "σ", "r", "w")
    to.table(map(say, headers), rows, 5, bold, most)


def _images(to: Writer, data: PageData) -> None:
    say, view = data.words, data.view
    angle = view.summary["units"]["angle"]
    place, turn = (
        sigma_decimals(view.images.select(names).drop_nulls().to_numpy().ravel())
        for names in (["sx", "sy", "sz"], ["somega", "sphi", "skappa"])
    )
    digits = dict.fromkeys("xyz", place) | dict.fromkeys(("omega", "phi", "kappa"), turn)
    numbers = " ".join(f"{s}{name}:.{count}f" for s in ("", "s") for name, count in digits.items())
    rows = [_cells(row, f"id camera {numbers} points") for row in data.images.to_dicts()]
    units = {axis: angle if axis in "ωφκ" else view.length for axis in "XYZωφκ"}
    headers = (f"{s}{axis} [{unit}]" for s in ("", "σ ") for axis, unit in units.items())
    to.table(map(say, ("image", "camera", *headers, "points")), rows, 2)


def _covariances(to: Writer, data: PageData) -> None:
    say, view = data.words, data.view
    to.text(say("Standard deviations and correlations of the coordinates of each point."))
    rows = [_cells(row, "id sx:.4g sy:.4g sz:.4g rxy:.4f rxz:.4f ryz:.4f") for row in view.points.to_dicts()]
    to.table((say("point"), *(f"σ{axis} [{view.length}]" for axis in "XYZ"), "r(XY)", "r(XZ)", "r(YZ)"), rows)
    if view.relative:
        to.heading(say("Distances and relative error ellipses"), 3)
        lengths = (f"{name} [{view.length}]" for name in (say("distance"), "σ", "a", "b"))
        pairs = [_cells(row, "from to distance:.9g sdistance:.3g a:.3g b:.3g") for row in view.relative]
        to.table((say("from"), say("to"), *lengths), pairs, 2)


def _residual(row: dict[str, Any], say: Words) -> list[str]:
    return [say.listed(row["flag"]), *_cells(row, "unit observed:.9g v:.3g sigma:.3g r:.3f w:.2f")]


def _cells(row: dict[str, Any], columns: str) -> list[str]:
    return cells(row, columns, "–", "−")
