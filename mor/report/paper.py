"""The report on paper: a PDF of a few pages that can be signed, with appendices on request."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Sequence
from io import BytesIO
from pathlib import Path
from typing import Any, NamedTuple

import polars as pl
import yaml

from mor.errors import InputError, Message, escaped, shortened
from mor.report.language import ENGLISH, Words
from mor.report.layout import DIGITS, in_words, persons, sigma_decimals, small_unit
from mor.report.page import agreement, cameras_of_page, determination, judgements, sigma_words
from mor.report.page_data import PageData, checked_coordinates, control_table, deviations, page_data
from mor.report.plots import ellipses, spell_out, style
from mor.report.verdict import said_conventions, uncontrolled_in_words
from mor.report.view import View

APPENDICES = ("residuals", "images", "covariances")
MOST_POINTS = 150
"""Points that are listed; of more, the least precise ones."""
MOST_ROWS = 40
"""Rows of every other table."""
_LONGEST_NAME = 36
_SIZE = 7.75
_SMALLEST = 5.0
"""Sizes of the letters of tables, points."""
_SERIF = {"": "DejaVuSans.ttf", "-Bold": "DejaVuSans-Bold.ttf", "-Mono": "DejaVuSansMono.ttf"}
_WIDTH, _HEIGHT, _DOTS = 7.5, 4.1, 200
"""Size of the figure in inches, and its dots per inch."""


class Grid(NamedTuple):
    """A table: headings, rows of finished cells, and how many columns on the left are text."""

    headers: Sequence[str]
    rows: Sequence[Sequence[str]]
    left: int = 1
    bold: frozenset[int] = frozenset()
    """Numbers of the rows that are set in bold type."""


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

    def table(self, grid: Grid) -> None:
        """Add a table. Cells are wrapped between words only; a table that is too wide gets smaller letters."""
        from reportlab.lib.colors import HexColor
        from reportlab.pdfbase.pdfmetrics import stringWidth
        from reportlab.platypus import LongTable, Paragraph, Spacer

        if not grid.rows:
            return
        columns = [k for k in range(len(grid.headers)) if any(row[k] for row in grid.rows)]
        left = sum(k < grid.left for k in columns)
        lines = [[_cell(row[k]) for k in columns] for row in (grid.headers, *grid.rows)]
        for line in lines[1:]:
            line[left:] = [text.replace(" ", "\u00a0") for text in line[left:]]
        size, gap = _SIZE, 7.0
        while True:
            whole, least = (
                [max(column) for column in zip(*rows, strict=True)] for rows in _extents(lines, size, stringWidth)
            )
            room = self.width - gap * len(columns)
            if sum(least) <= room or size <= _SMALLEST:
                break
            size -= 0.25
        widths = _shared(whole, least, room)
        cells: list[list[Any]] = []
        for number, line in enumerate(lines):
            font = "mor-Bold" if number == 0 or number - 1 in grid.bold else "mor"
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
            *(("FONT", (0, k + 1), (-1, k + 1), "mor-Bold", size, 1.2 * size) for k in grid.bold),
        ]
        if left == 0:
            commands.pop(2)
        drawn.setStyle(commands)
        self._story += [drawn, Spacer(1.0, 5.0)]

    def facts(self, rows: Iterable[tuple[str, str]]) -> None:
        """Add a table of names and values without a heading."""
        from reportlab.platypus import Paragraph, Table

        cells = [
            [
                Paragraph(_marked(name), self._look("mor", 8.0)),
                Paragraph(_marked(text), self._look("mor", 8.0)),
            ]
            for name, text in rows
        ]
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

    def lines(self, text: str) -> None:
        """Add a text as it stands, in letters of one width."""
        from reportlab.platypus import Preformatted

        look = self._look("mor-Mono", 7.2)
        self._story += [Preformatted(line or " ", look) for line in escaped(text).split("\n")]

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
    """The fonts of Matplotlib, which have Greek letters and signs of mathematics."""
    from reportlab.pdfbase.pdfmetrics import getRegisteredFontNames, registerFont
    from reportlab.pdfbase.ttfonts import TTFont

    if "mor" in getRegisteredFontNames():
        return
    with style():
        from matplotlib import get_data_path
    for suffix, file in _SERIF.items():
        registerFont(TTFont(f"mor{suffix}", str(Path(get_data_path()) / "fonts" / "ttf" / file)))


def _marked(text: str) -> str:
    return escaped(text).replace("&", "&amp;").replace("<", "&lt;").replace(">", "&gt;")


def _cell(text: str) -> str:
    """A cell: names too long for any column are shortened, so that no word needs to be broken."""
    return " ".join(shortened(word, _LONGEST_NAME + 28) for word in escaped(text).split(" ") if word)


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


def report_on_paper(view: View, folder: Path, appendices: Sequence[str], paper: str, words: Words = ENGLISH) -> Writer:
    """Return the report of results that stand in ``folder``. Raises :class:`InputError` for an unknown appendix."""
    known = there(view)
    for name in appendices:
        if name not in known:
            raise InputError([Message(f"no appendix {name!r} of these results (known: {', '.join(known)})")])
    title = view.summary["title"] or words("Adjustment")
    right = " · ".join(part for part in (view.identity["date"], view.identity["program"]) if part)
    to, data = Writer(title, paper, words, right), page_data(view, words)
    to.heading(title, 1)
    for section in (
        _identity,
        _verdict,
        _figure,
        _adjusted,
        _datum,
        _cameras,
        _control,
        _movements,
        _weakest,
        _flagged,
        _points,
    ):
        section(to, data, folder)
    _inputs(to, data)
    to.signature()
    for name in appendices:
        to.new_page()
        to.heading(words("Appendix: {name}", name=words(name)))
        {"residuals": _residuals, "images": _images, "covariances": _covariances}[name](to, data)
    return to


def there(view: View) -> list[str]:
    """Names of the appendices that the results have something for."""
    found = {
        "residuals": view.residuals.height,
        "images": view.images.height,
        "covariances": "rxy" in view.points.columns and view.points.height,
    }
    return [name for name in APPENDICES if found[name]]


def _identity(to: Writer, data: PageData, folder: Path) -> None:
    say, view = data.words, data.view
    units = view.summary["units"]
    to.facts(
        [
            *persons(view.identity, say),
            (say("program"), view.identity["program"]),
            (say("options"), " ".join(view.identity["options"]) or say("none")),
            (
                say("units"),
                say("lengths in {length}, angles in {angle}", **units) + "; " + say("residual v = adjusted − observed"),
            ),
        ]
    )


def _verdict(to: Writer, data: PageData, folder: Path) -> None:
    say, summary = data.words, data.view.summary
    to.heading(say("Verdict"))
    for name, part in ((say("Agreement"), agreement(data)), (say("Determination"), determination(data))):
        to.text(f"{name}: {part.title}", bold=True)
        to.text(part.words)
    test, sigma0 = summary["global_test"], summary["sigma0"]
    rows = [
        (say("observations n"), str(summary["observations"])),
        (say("unknowns u"), str(summary["unknowns"])),
        (say("datum defect d"), f"{summary['defect']}"),
        (say("redundancy n − u + d"), str(summary["redundancy"])),
        (say("σ0 a priori [1]"), f"{sigma0['apriori']:.6g}"),
        (
            say("σ0 a posteriori [1]"),
            f"{sigma0['aposteriori']:.6g}" if sigma0["aposteriori"] is not None else "–",
        ),
        ("vᵀPv", f"{test['statistic']:.1f} ({test['lower']:.1f} … {test['upper']:.1f})"),
    ]
    to.facts(rows)
    to.heading(say("Judgements"), 3)
    to.table(
        Grid(
            (say("judged"), say("result")),
            [(one.title, f"{_SIGNS[one.state]} {one.words}") for one in judgements(data)],
            2,
        )
    )


_SIGNS = {"good": "✓", "doubt": "!", "bad": "✗", "plain": "·"}


def _figure(to: Writer, data: PageData, folder: Path) -> None:
    if not data.view.points.height:
        return
    to.heading(data.words("Network"), room=to.width * _HEIGHT / _WIDTH + 35.0)
    with style():
        to.picture(ellipses(data.view, data.words, size=(_WIDTH, _HEIGHT), effects=False))


def _adjusted(to: Writer, data: PageData, folder: Path) -> None:
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
    rows = [
        (
            row["group"],
            row["type"],
            row["component"],
            _given_as(row, say),
            row["unit"],
            str(row["n"]),
            _range(row),
        )
        for row in sigmas.head(MOST_ROWS).to_dicts()
    ]
    to.heading(say("Standard deviations a priori"), 3)
    to.table(Grid((say("group"), say("type"), say("component"), say("given as"), say("unit"), "n", "σ"), rows, 5))
    _more(to, sigmas.height)
    judged = {
        (row["name"], row["observations"]): row
        for row in (view.verdict or {}).get("groups", [])
        if row["of"] == "group"
    }
    groups = view.groups.to_dicts()
    rejected = {key for key, row in judged.items() if row["rejected"]}
    table = []
    for row in groups[:MOST_ROWS]:
        test = judged.get((row["name"], row["observations"]))
        result = (
            "–"
            if test is None
            else f"{say('rejected') if test['rejected'] else say('accepted')} (p\u00a0=\u00a0{test['p']:.2g})"
        )
        table.append(
            (
                row["name"],
                row["type"],
                result,
                str(row["observations"]),
                _fixed(row["redundancy"], 1),
                _fixed(row["sigma0"], 3),
                _fixed(row["largest_w"], 2),
                str(row["flagged"]),
            )
        )
    bold = frozenset(k for k, row in enumerate(groups[:MOST_ROWS]) if (row["name"], row["observations"]) in rejected)
    components = view.summary.get("variance_components") or {}
    to.note(
        say("The standard deviations are variance components estimated from the residuals.")
        if components.get("iterated")
        else say("The project gives these standard deviations; the tests of the groups judge them.")
    )
    to.heading(say("Observation groups"), 3)
    to.table(
        Grid(
            (
                say("group"),
                say("type"),
                say("test"),
                "n",
                "Σ r",
                say("σ0 of the group [1]"),
                say("largest |w| [1]"),
                say("flagged"),
            ),
            table,
            3,
            bold,
        )
    )
    _more(to, len(groups))


def _range(row: dict[str, Any]) -> str:
    low, high = f"{row['low']:.3g}", f"{row['high']:.3g}"
    return low if low == high else f"{low} … {high}"


def _given_as(row: dict[str, Any], say: Words) -> str:
    """Whether one σ holds for the group or each observation has its own."""
    if row["n"] == 1:
        return ""
    return say("one for each observation") if "…" in _range(row) else say("one value for all")


def _datum(to: Writer, data: PageData, folder: Path) -> None:
    """Which points and components hold the datum, and how."""
    say, view = data.words, data.view
    to.heading(say("Datum"))
    named = say("{datum}. Coordinates and σ refer to it.", datum=data.datum)
    to.text(named[:1].upper() + named[1:])
    for line in said_conventions(view.verdict, say) if view.verdict else ():
        to.text(line)
    declared = _declared_datum(folder)
    if declared:
        to.text(say("The project declares: {datum}", datum=declared))
    held = [
        (row["point"], say("observed"), row["component"].upper(), f"{row['sigma']:.3g} {row['unit']}")
        for row in control_table(view).to_dicts()
        if row["sigma"]
    ]
    rows: dict[tuple[str, str, str], list[str]] = {}
    for point, how, component, sigma in held:
        rows.setdefault((point, how, sigma), []).append(component)
    if "status" in view.points.columns:
        for row in view.points.filter(pl.col("status").is_in(["fixed", "partly fixed"])).to_dicts():
            rows[(str(row["id"]), say("fixed"), "–")] = [axis.upper() for axis in "xyz" if not row[f"s{axis}"]]
    listed = [
        (point, "".join(dict.fromkeys(components)), how, sigma) for (point, how, sigma), components in rows.items()
    ]
    if listed:
        to.text(say("These coordinates hold the datum:"))
    to.table(Grid((say("point"), say("components"), say("held as"), say("σ given")), listed[:MOST_ROWS], 3))
    _more(to, len(listed))


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


def _cameras(to: Writer, data: PageData, folder: Path) -> None:
    say = data.words
    if not data.view.cameras:
        return
    to.heading(say("Cameras"))
    for camera in cameras_of_page(data.view):
        to.heading(say("Camera {id} – model {model}", id=camera["id"], model=camera["model"]), 3)
        rows = [
            (
                row["name"],
                say(row["meaning"]) if row["meaning"] else "",
                say(row["status"]),
                row["unit"],
                _short(row["value"], 8),
                _short(row["sigma"], 3),
                _fixed(row["t"], 1),
                _p(row["p"]),
            )
            for row in camera["rows"]
            if row["sigma"] or row["value"]
        ]
        to.table(
            Grid(
                (say("name"), say("meaning"), say("status"), say("unit"), say("value"), "σ", "|t|", "p"),
                rows,
                4,
            )
        )


def _control(to: Writer, data: PageData, folder: Path) -> None:
    say, view, control = data.words, data.view, control_table(data.view)
    parts = [
        (kind, row)
        for kind, rows in (
            ("control points", deviations(control)),
            ("check points", deviations(checked_coordinates(view))),
        )
        for row in rows
    ]
    if not (parts or control.height or view.checks):
        return
    to.heading(say("Control and checks"))
    to.table(
        Grid(
            (say("points"), say("component"), say("unit"), "n", say("mean"), say("rms"), say("largest")),
            [
                (
                    say(kind),
                    row["component"],
                    row["unit"],
                    str(row["count"]),
                    _in(row["unit"], row["mean"]),
                    _in(row["unit"], row["rms"]),
                    _in(row["unit"], row["largest"]),
                )
                for kind, row in parts
            ],
            3,
        )
    )
    rows = [(row["point"], row["component"].upper(), *_residual(row, say)) for row in control.to_dicts()]
    to.table(
        Grid(
            (
                say("point"),
                say("component"),
                say("flag"),
                say("unit"),
                say("given"),
                "v",
                "σ",
                "r [1]",
                "w [1]",
            ),
            rows[:MOST_ROWS],
            4,
        )
    )
    _more(to, len(rows))
    to.table(
        Grid(
            (
                say("checks"),
                say("component"),
                say("unit"),
                "n",
                say("mean"),
                say("rms"),
                say("largest"),
                say("beyond test"),
            ),
            [
                (
                    row["group"],
                    row["component"],
                    row["unit"],
                    _fixed(row["count"], 0),
                    _in(row["unit"], row["mean"]),
                    _in(row["unit"], row["rms"]),
                    _in(row["unit"], row["largest"]),
                    _fixed(row["exceeding"], 0),
                )
                for row in view.checks[:MOST_ROWS]
            ],
            3,
        )
    )


def _movements(to: Writer, data: PageData, folder: Path) -> None:
    """Movements of every point from its first to its last epoch, those that moved most significantly first."""
    say, frame = data.words, data.view.movements
    if not frame.height:
        return
    last = frame.group_by("point", maintain_order=True).last().sort("p", nulls_last=True, maintain_order=True)
    sizes = [abs(value) for axis in "xyz" for value in last[axis].drop_nulls()]
    unit, factor = small_unit(data.view.length, max(sizes, default=1.0))
    places = sigma_decimals(last.select("sx", "sy", "sz").drop_nulls().to_numpy().ravel() * factor)
    to.heading(say("Movements from the first to the last epoch"))
    to.text(say("{count:point has|points have} moved, of {all}", count=int(last["moved"].sum()), all=last.height) + ".")
    rows = last.head(MOST_ROWS).to_dicts()
    cells = [
        (
            row["point"],
            row["from"],
            row["to"],
            say("moved") if row["moved"] else "–",
            *(_fixed(row[f"{s}{axis}"], places, factor) for s in ("", "s") for axis in "xyz"),
            _fixed(row["test"], 2),
            _p(row["p"]),
        )
        for row in rows
    ]
    headers = (
        say("point"),
        say("from"),
        say("to"),
        say("result"),
        *(f"{s}{axis} [{unit}]" for s in ("Δ", "σΔ") for axis in "XYZ"),
        say("test"),
        "p",
    )
    to.table(Grid(headers, cells, 4, frozenset(k for k, row in enumerate(rows) if row["moved"])))
    _more(to, last.height)


def _weakest(to: Writer, data: PageData, folder: Path) -> None:
    """The least precise points, and observations and points that are controlled least."""
    say, view = data.words, data.view
    to.heading(say("Weakest spots"))
    if "ellipsoid_a" in data.points.columns and data.points["ellipsoid_a"].drop_nulls().len():
        worst = (
            data.points.filter(pl.col("ellipsoid_a").is_not_null())
            .sort("ellipsoid_a", descending=True, maintain_order=True)
            .head(5)
        )
        unit, factor = small_unit(view.length, worst["ellipsoid_a"][0])
        to.heading(say("Least precise points"), 3)
        to.table(
            Grid(
                (say("point"), f"{say('ellipsoid a')} [{unit}]", say("rays"), say("others")),
                [
                    (
                        str(row["id"]),
                        f"{row['ellipsoid_a'] * factor:.3g}",
                        str(row["rays"]),
                        str(row["others"]),
                    )
                    for row in worst.to_dicts()
                ],
                1,
            )
        )
    if view.reliability is None:
        return
    for line in uncontrolled_in_words(view.reliability, say):
        to.text(line)
    rows = [
        (
            say(kind),
            row["id"],
            in_words(row["weakest"], say),
            row["weakest"]["unit"],
            f"{row['smallest_r']:.2f}",
            _short(row["nabla"], 3),
            _short(row["shift"], 3),
        )
        for key, kind in (("points", "point"), ("images", "image"), ("stations", "station"))
        for row in sorted(view.reliability[key], key=lambda row: float(row["smallest_r"]))[:4]
    ]
    to.heading(say("Least controlled"), 3)
    to.table(
        Grid(
            (
                say("weakest"),
                "id",
                say("observation"),
                say("unit"),
                say("smallest r"),
                "∇",
                f"{say('effect')} [{view.length}]",
            ),
            rows,
            4,
        )
    )


def _flagged(to: Writer, data: PageData, folder: Path) -> None:
    say, gross = data.words, data.view.gross_errors
    flagged = [row for row in gross.get("suspicious", []) if row["flagged"]]
    out = data.view.residuals.filter(pl.col("flag") == "excluded")
    to.heading(say("Flagged observations"))
    if not flagged and not out.height:
        to.text(say("No observation is flagged."))
    rows = [
        (
            in_words(row, say),
            row["unit"],
            _fixed(row["w"], 2),
            _fixed(row["r"], 3),
            _short(row["error"], 3),
            _short(row["nabla"], 3),
        )
        for row in flagged
    ]
    to.table(
        Grid(
            (
                say("observation"),
                say("unit"),
                "w [1]",
                "r [1]",
                say("estimated error"),
                say("∇ smallest detectable"),
            ),
            rows[:MOST_ROWS],
            2,
        )
    )
    _more(to, len(rows))
    if out.height:
        to.heading(say("Excluded from the adjustment"), 3)
        to.table(_observations(out.head(MOST_ROWS), say))
        _more(to, out.height)


def _points(to: Writer, data: PageData, folder: Path) -> None:
    say, view, points = data.words, data.view, data.points
    if not points.height:
        return
    to.heading(say("Points"))
    if points.height > MOST_POINTS:
        to.text(
            say(
                "The {count} least precise of {all} points; the table of points has all of them.",
                count=MOST_POINTS,
                all=points.height,
            )
        )
        points = points.sort("ellipsoid_a", descending=True, nulls_last=True, maintain_order=True).head(MOST_POINTS)
    sigma = points.select("sx", "sy", "sz").drop_nulls().to_numpy().ravel()
    places = sigma_decimals(sigma[sigma > 0.0]) if (sigma > 0.0).any() else 4
    unit, factor = small_unit(view.length, float(sigma.max(initial=0.0)) or 1.0)
    fine = sigma_decimals(sigma[sigma > 0.0] * factor) if (sigma > 0.0).any() else 2
    rows = [
        (
            str(row["id"]),
            say(row["status"]),
            *(_fixed(row[axis], places) for axis in "xyz"),
            *(_fixed(row[f"s{axis}"], fine, factor) for axis in "xyz"),
            *(_fixed(row.get(f"ellipse_{name}"), fine, factor) for name in "ab"),
            _fixed(row.get("ellipse_azimuth"), 1),
            str(row["rays"] + row["others"]),
        )
        for row in points.to_dicts()
    ]
    headers = (
        say("point"),
        say("status"),
        *(f"{axis} [{view.length}]" for axis in "XYZ"),
        *(f"σ{axis} [{unit}]" for axis in "XYZ"),
        f"a [{unit}]",
        f"b [{unit}]",
        f"{say('azimuth of a')} [{view.summary['units']['angle']}]",
        "n",
    )
    to.table(Grid(headers, rows, 2))
    to.note(
        f"{sigma_words(data)}. "
        + say("a, b: semi-axes of the standard ellipse in plan; n: rays and other observations of the point.")
    )


def _inputs(to: Writer, data: PageData) -> None:
    say, view = data.words, data.view
    files = view.identity["inputs"]
    together = 13.0 * (len(files) + 2 * len(view.notes)) + 150.0
    to.heading(say("Inputs"), room=min(together, 0.5 * to.size[1]))
    to.table(
        Grid(
            (say("file"), say("SHA-256"), say("bytes")),
            [(file["file"], file["sha256"], str(file["bytes"])) for file in files[:MOST_ROWS]],
            2,
        )
    )
    _more(to, len(files))
    if view.notes:
        to.heading(say("Notes on what was read"), 3)
        rows = [
            (f"{row['file']}:{row['line']}" if row["line"] else row["file"] or "", say.told(row["message"]))
            for row in view.notes[:MOST_ROWS]
        ]
        to.table(Grid((say("file"), say("note")), rows, 2))
        _more(to, len(view.notes))


def _more(to: Writer, count: int) -> None:
    if count > MOST_ROWS:
        to.note(to.words("{count:more is|more are} in the results.", count=count - MOST_ROWS))


# ---- Appendices.


def _residuals(to: Writer, data: PageData) -> None:
    to.table(_observations(data.view.residuals, data.words))


def _observations(frame: pl.DataFrame, say: Words) -> Grid:
    rows = [
        (
            row["type"],
            " – ".join(part for part in (row["at"], row["from"], row["to"]) if part),
            row["component"],
            *_residual(row, say),
        )
        for row in frame.iter_rows(named=True)
    ]
    bold = frozenset(k for k, flag in enumerate(frame["flag"]) if flag)
    return Grid(
        (
            say("type"),
            say("between"),
            say("component"),
            say("flag"),
            say("unit"),
            say("observed"),
            "v",
            "σ",
            "r",
            "w",
        ),
        rows,
        5,
        bold,
    )


def _images(to: Writer, data: PageData) -> None:
    say, view = data.words, data.view
    angle = view.summary["units"]["angle"]
    place, turn = (
        sigma_decimals(view.images.select(names).drop_nulls().to_numpy().ravel())
        for names in (["sx", "sy", "sz"], ["somega", "sphi", "skappa"])
    )
    names = (
        *(("xyz"[k], f"{'XYZ'[k]} [{view.length}]", place) for k in range(3)),
        *((("omega", "phi", "kappa")[k], f"{'ωφκ'[k]} [{angle}]", turn) for k in range(3)),
    )
    rows = [
        (
            str(row["id"]),
            row["camera"],
            *(_fixed(row[f"{s}{name}"], places) for s in ("", "s") for name, _, places in names),
            str(row["points"]),
        )
        for row in data.images.to_dicts()
    ]
    to.table(
        Grid(
            (
                say("image"),
                say("camera"),
                *(f"{s}{title}" for s in ("", "σ ") for _, title, _ in names),
                say("points"),
            ),
            rows,
            2,
        )
    )


def _covariances(to: Writer, data: PageData) -> None:
    say, view = data.words, data.view
    to.text(say("Standard deviations and correlations of the coordinates of each point."))
    rows = [
        (
            str(row["id"]),
            *(_short(row[f"s{axis}"], 4) for axis in "xyz"),
            *(_fixed(row[name], 4) for name in ("rxy", "rxz", "ryz")),
        )
        for row in view.points.to_dicts()
    ]
    to.table(
        Grid(
            (say("point"), *(f"σ{axis} [{view.length}]" for axis in "XYZ"), "r(XY)", "r(XZ)", "r(YZ)"),
            rows,
            1,
        )
    )
    pairs = [
        (
            row["from"],
            row["to"],
            _short(row["distance"], 9),
            _short(row["sdistance"], 3),
            _short(row["a"], 3),
            _short(row["b"], 3),
        )
        for row in view.relative
    ]
    if pairs:
        to.heading(say("Distances and relative error ellipses"), 3)
        to.table(
            Grid(
                (
                    say("from"),
                    say("to"),
                    *(f"{name} [{view.length}]" for name in (say("distance"), "σ", "a", "b")),
                ),
                pairs,
                2,
            )
        )


def _residual(row: dict[str, Any], say: Words) -> tuple[str, ...]:
    return (
        say.listed(row["flag"]),
        row["unit"],
        _short(row["observed"], 9),
        _short(row["v"], 3),
        _short(row["sigma"], 3),
        _fixed(row["r"], 3),
        _fixed(row["w"], 2),
    )


def _fixed(value: float | None, digits: int, factor: float = 1.0) -> str:
    """A number with so many decimals; zero has no sign."""
    if value is None:
        return "–"
    return f"{round(value * factor, digits) + 0.0:.{digits}f}".replace("-", "−")


def _short(value: float | None, digits: int) -> str:
    return "–" if value is None else f"{value:.{digits}g}".replace("-", "−")


def _p(value: float | None) -> str:
    return "–" if value is None else "< 0.0001" if value < 1e-4 else f"{value:.4f}"


def _in(unit: str, value: float | None) -> str:
    return _fixed(value, DIGITS[unit]) if unit in DIGITS else _short(value, 3)


def text_on_paper(text: str, paper: str, words: Words = ENGLISH) -> Writer:
    """Return a text on sheets, as it stands; its first line is their head."""
    to = Writer(text.split("\n", 1)[0], paper, words)
    to.lines(text)
    return to
