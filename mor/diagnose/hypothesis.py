"""Hypotheses about mistakes, the edits that undo them, and the situation they are tried in."""

from __future__ import annotations

import difflib
import re
from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from functools import cached_property
from itertools import accumulate, pairwise
from pathlib import Path
from typing import Any, NamedTuple, TypeAlias

import numpy as np
import yaml

from mor.errors import InputError
from mor.input_files import read_text
from mor.linalg.cholesky import NotFiniteError
from mor.model.contract import ObservationGroup
from mor.model.parameters import Values
from mor.project.document import Document, KeyPath
from mor.project.network import Network
from mor.project.rows import group_name
from mor.project.schema import TableEntry
from mor.project.tables import our_name
from mor.quality.assessment import assess
from mor.quality.outliers import SUSPECT, cost_of_residuals, factor_of_sigmas, price_of_gross_error, sizes_of
from mor.quality.robust_estimation import exclude, robust_scales
from mor.quality.solution import AddedParameter, ScoredHypothesis
from mor.solve.iterate import Adjustment, Iteration, Outcome, SolverSettings, Watcher, adjust
from mor.solve.problem import Problem
from mor.types import BoolArray, FloatArray, IntArray

# ---- Edits of the files of a project that a hypothesis needs, and the unified diff of them. No file is written.
#
# An edit replaces text in place: a value of the project file, or a cell of a table in it or beside it.
# Comments, order and layout stay as they are. A hypothesis that cannot be expressed in this way has no diff:
# if a table is compressed, stands in a data frame, or its cells are given for all rows together.

CellChange: TypeAlias = Callable[[str, AddedParameter | None], str | None]
"""New text of a cell from the old one and the estimated amount; None if there is none."""


class KeyEdit(NamedTuple):
    """A value of the project file that is set, or replaced."""

    at: KeyPath
    text: Callable[[str, AddedParameter | None], str | None]
    """New text from the old one, which is empty if there is none yet."""


class CellEdit(NamedTuple):
    """A cell of a table that is replaced."""

    at: KeyPath
    """Path of the table in the project file, or of a section one of whose tables has the row."""
    column: str
    change: CellChange
    line: int = 0
    """Line of the row in its file; 0 if the row is found by its cells."""
    cells: Mapping[str, str] = {}
    """Cells by column that the row has."""


Edit: TypeAlias = KeyEdit | CellEdit


class _NotExpressibleError(Exception):
    """An edit that cannot be made in place."""


def key_edit(at: KeyPath, text: str) -> KeyEdit:
    """Return the edit that sets a value of the project file to a fixed text."""
    return KeyEdit(at, lambda _old, _amount: text)


def table_of(network: Network, number: int) -> KeyPath | None:
    """Return the path of the table of a group of observations, None if it comes from none."""
    name = network.groups[number].name
    found = [k for k, entry in enumerate(network.project.observations) if group_name(entry, k) == name]
    return ("observations", found[0]) if len(found) == 1 else None


def table_key(network: Network, number: int, name: str, text: str) -> tuple[Edit, ...]:
    """Return the edit that sets a key of the table of a group of observations."""
    at = table_of(network, number)
    return () if at is None else (key_edit((*at, name), text),)


def cells(network: Network, number: int, rows: Iterable[int], column: str, change: CellChange) -> tuple[Edit, ...]:
    """Return the edits of a column in some rows of a group of observations."""
    at, group = table_of(network, number), network.groups[number]
    rows = list(rows)
    if at is None or any(row >= len(group.lines) for row in rows):
        return ()
    return tuple(CellEdit(at, column, change, group.line(row), group.names_of(row)) for row in rows)


def to(text: str) -> CellChange:
    """Return the change of a cell to a fixed text."""
    return lambda _old, _amount: text


def computed(change: Callable[[float], float]) -> CellChange:
    """Return the change of a number in a cell, written with the digits it has; None if it is not a plain number."""

    def changed(old: str, _amount: AddedParameter | None) -> str | None:
        try:
            value = change(float(old))
        except ValueError:
            return None
        return _with_digits(value, old)

    return changed


def with_amount(change: Callable[[float, float], float]) -> CellChange:
    """Return the change of a number in a cell by the estimated amount; an empty cell counts as 0."""

    def changed(old: str, amount: AddedParameter | None) -> str | None:
        if amount is None:
            return None
        try:
            value = change(float(old or "0"), amount.value)
        except ValueError:
            return None
        return _with_digits(value, old if "." in old else "0.0000")

    return changed


def _with_digits(value: float, like: str) -> str:
    if "e" in like.lower():
        return f"{value:.10g}"
    digits = len(like.strip().partition(".")[2])
    return f"{value:.{digits}f}"


def as_diff(
    document: Document, folder: Path, edits: Sequence[Edit], amount: AddedParameter | None = None
) -> str | None:
    """Return the unified diff of the files that edits change, None if they cannot be expressed.

    Args:
        document: The project file as it was read; one in a foreign format has no diff.
        folder: Where its tables are.
        edits: What is changed, all at once.
        amount: The estimated parameter, for edits that write it.
    """
    project = Path(document.file)
    if not edits or document.files or project.suffix.lower() not in (".yaml", ".yml") or not project.is_file():
        return None
    try:
        return _Files(document, project, folder).diff(edits, amount)
    except (_NotExpressibleError, InputError, yaml.YAMLError, RecursionError):
        return None


class _Files:
    """The texts of a project and the pieces of them that are replaced."""

    def __init__(self, document: Document, project: Path, folder: Path) -> None:
        self.document, self.project, self.folder = document, project, folder
        self.texts: dict[Path, str] = {}
        self.lines: dict[Path, tuple[list[str], list[int]]] = {}
        """Lines of a table, and the place in its text at which each begins."""
        self.pieces: dict[Path, dict[tuple[int, int], str]] = {}
        self.root: Any = None
        self.repeated: set[int] = set()

    def diff(self, edits: Sequence[Edit], amount: AddedParameter | None) -> str:
        for edit in edits:
            if isinstance(edit, KeyEdit):
                self._set(edit, amount)
            else:
                self._change_cell(edit, amount)
        return "".join(self._of_file(path) for path in self.pieces)

    def _of_file(self, path: Path) -> str:
        old, new = self.texts[path], self.texts[path]
        for (start, end), text in sorted(self.pieces[path].items(), reverse=True):
            new = new[:start] + text + new[end:]
        name = path.name if path.parent == self.project.parent else str(path)
        lines = difflib.unified_diff(old.splitlines(keepends=True), new.splitlines(keepends=True), name, name, n=1)
        return "".join(line if line.endswith("\n") else f"{line}\n" for line in lines)

    def _text(self, path: Path) -> str:
        if path not in self.texts:
            if path.suffix.lower() in (".gz", ".parquet") or not path.is_file():
                raise _NotExpressibleError
            self.texts[path] = read_text(path)
            if len(self.texts[path]) > 4_000_000:  # characters; of larger files no diff is made
                raise _NotExpressibleError
        return self.texts[path]

    def _replace(self, path: Path, start: int, end: int, text: str | None) -> None:
        pieces = self.pieces.setdefault(path, {})
        if text is None or pieces.get((start, end), text) != text:
            raise _NotExpressibleError
        pieces[start, end] = text

    def _tree(self) -> Any:
        if self.root is None:
            loader = getattr(yaml, "CSafeLoader", yaml.SafeLoader)
            self.root = yaml.compose(self._text(self.project), Loader=loader)
            seen: set[int] = set()
            waiting = [self.root]
            while waiting:
                node = waiting.pop()
                if id(node) in seen:  # an alias: what is changed in one place would be in another one as well
                    self.repeated.add(id(node))
                    continue
                seen.add(id(node))
                if isinstance(node, yaml.MappingNode):
                    waiting += [one for pair in node.value for one in pair]
                elif isinstance(node, yaml.SequenceNode):
                    waiting += node.value
        return self.root

    def _walk(self, at: KeyPath) -> tuple[Any, KeyPath]:
        """The deepest value there is on a path, and the rest of the path."""
        node = self._tree()
        for place, step in enumerate(at):
            below = None
            if isinstance(node, yaml.SequenceNode) and isinstance(step, int) and step < len(node.value):
                below = node.value[step]
            elif isinstance(node, yaml.MappingNode):
                below = next((v for k, v in node.value if k.value == str(step)), None)
            if below is None:
                return node, at[place:]
            if id(below) in self.repeated:
                raise _NotExpressibleError
            node = below
        return node, ()

    def _set(self, edit: KeyEdit, amount: AddedParameter | None) -> None:
        node, rest = self._walk(edit.at)
        whole = self._text(self.project)
        if not rest:
            if not isinstance(node, yaml.ScalarNode) and not node.flow_style:
                raise _NotExpressibleError
            start, end = node.start_mark.index, node.end_mark.index
            self._replace(self.project, start, end, edit.text(whole[start:end], amount))
            return
        text = edit.text("", amount)
        if text is None or not isinstance(node, yaml.MappingNode):
            raise _NotExpressibleError
        first, *inner = (str(step) for step in rest)
        for step in reversed(inner):
            text = f"{{{step}: {text}}}"
        if node.flow_style:
            place = node.end_mark.index - 1
            comma = ", " if node.value else ""
            self._replace(self.project, place, place, f"{comma}{first}: {text}")
            return
        name, value = node.value[0]
        indent = " " * name.start_mark.column
        if isinstance(value, yaml.ScalarNode) and value.start_mark.line == value.end_mark.line:
            place = whole.find("\n", value.end_mark.index)
            place = len(whole) if place < 0 else place
            self._replace(self.project, place, place, f"\n{indent}{first}: {text}")
        else:
            self._replace(self.project, name.start_mark.index, name.start_mark.index, f"{first}: {text}\n{indent}")

    def _change_cell(self, edit: CellEdit, amount: AddedParameter | None) -> None:
        table: Any = self.document.data
        for step in edit.at:
            table = table[step]
        if isinstance(table, list):  # any table of the section
            self._change_in_any(edit, len(table), amount)
        elif table.get("rows") is not None:
            self._change_in_place(edit, table, amount)
        elif isinstance(table.get("file"), str):
            self._change_in_file(edit, table, amount)
        else:
            raise _NotExpressibleError

    def _change_in_any(self, edit: CellEdit, count: int, amount: AddedParameter | None) -> None:
        done = 0
        for k in range(count):
            try:
                self._change_cell(edit._replace(at=(*edit.at, k)), amount)
                done += 1
            except _NotExpressibleError:
                continue
        if done != 1:
            raise _NotExpressibleError

    def _change_in_place(self, edit: CellEdit, table: Any, amount: AddedParameter | None) -> None:
        columns = table["columns"]
        whole = self._text(self.project)
        fitting = []
        for k, row in enumerate(table["rows"]):
            named = dict(zip(columns, row, strict=False))
            line = self.document.line((*edit.at, "rows", k))
            if edit.line in (0, line) and all(named.get(c) == text for c, text in edit.cells.items()):
                fitting.append(k)
        if len(fitting) != 1 or edit.column not in columns:
            raise _NotExpressibleError
        node, rest = self._walk((*edit.at, "rows", fitting[0], columns.index(edit.column)))
        if rest or not isinstance(node, yaml.ScalarNode):
            raise _NotExpressibleError
        start, end = node.start_mark.index, node.end_mark.index
        text = edit.change(node.value, amount)
        if text is not None and (not text or re.search(r"[^\w.+\-]", text) or whole[start : start + 1] in "\"'"):
            text = '"' + text.replace("\\", "\\\\").replace('"', '\\"') + '"'
        self._replace(self.project, start, end, text)

    def _change_in_file(self, edit: CellEdit, table: Any, amount: AddedParameter | None) -> None:
        path = self.folder / table["file"]
        if table["file"] in self.document.frames:
            raise _NotExpressibleError
        if path not in self.lines:
            split = self._text(path).split("\n")
            ends = accumulate((len(line) + 1 for line in split), initial=0)
            self.lines[path] = split, list(ends)
        lines, begins = self.lines[path]
        delimiter = table.get("delimiter") or ","
        if delimiter == " ":
            raise _NotExpressibleError
        declared = table.get("columns")
        used = [k for k, line in enumerate(lines) if line.strip() and not line.lstrip().startswith("#")]
        if isinstance(declared, list):
            header = list(declared)
        else:
            model = TableEntry.model_construct(columns=declared)
            header = [our_name(model, name.strip().lstrip("\ufeff")) for name in lines[used[0]].split(delimiter)]
            used = used[1:]
        if edit.column not in header:
            raise _NotExpressibleError
        places = [edit.line - 1] if edit.line else used
        fitting = []
        for k in places:
            parts = lines[k].split(delimiter) if 0 <= k < len(lines) else []
            if '"' in lines[k] or " #" in lines[k] or len(parts) != len(header):
                if edit.line:
                    raise _NotExpressibleError
                continue
            named = {c: part.strip() for c, part in zip(header, parts, strict=True)}
            if all(named.get(c, text) == text for c, text in edit.cells.items()):
                fitting.append((k, parts))
        if len(fitting) != 1:
            raise _NotExpressibleError
        row, parts = fitting[0]
        column = header.index(edit.column)
        old = parts[column]
        bare = old.strip()
        start = begins[row] + sum(len(part) + 1 for part in parts[:column])
        start += len(old) - len(old.lstrip()) if bare else 0
        text = edit.change(bare, amount)
        if text is not None and (delimiter in text or '"' in text or "\n" in text):
            raise _NotExpressibleError
        self._replace(path, start, start + len(bare), text)


# ---- Hypotheses: changes of a project that would make its observations agree.


@dataclass(frozen=True)
class Hypothesis:
    """A mistake that may have been made, as the change of the network that undoes it."""

    cause: str
    """Key of the cause: ``names exchanged``, ``distance offset`` …"""
    things: tuple[str, ...]
    """Names of what it is about, those of points and instruments or of tables."""
    change: Callable[[Network], Network]
    line: str
    """What to write in the project to try it."""
    candidates: int = 1
    """How many of its kind were looked through."""
    parameters: int = 0
    """Additional unknowns."""
    stretch: float = 0.0
    """Σ ln |dl'/dl| of changed observations, less Σ ln (σ'/σ): densities change with the unit, as far as controlled."""
    rows: tuple[tuple[int, int], ...] = ()
    """(group, row) of the few observations it changes; none where it changes many."""
    recomputed: Mapping[str, IntArray] = field(default_factory=dict)
    """Blocks of each kind that begin from the given start values again; where none are given, from all else."""
    afresh: bool = False
    """True where missing start values are worth being worked out again."""
    edits: tuple[Edit, ...] = ()
    """Edits of the files of the project; none if it cannot be expressed by any."""
    amount: Callable[[Values], AddedParameter] | None = None
    """What its additional unknown is at a solution."""

    def amount_at(self, values: Values) -> AddedParameter | None:
        """Its additional unknown at a solution; nothing where it has none."""
        return None if self.amount is None else self.amount(values)


class NetworkFit(NamedTuple):
    """Fit of a network to its observations."""

    values: Values
    omega: float
    """vᵀPv."""
    freedom: int
    length: float
    """Description length: see :mod:`mor.quality.outliers`."""
    scale: float
    """Factor of all σ by the median of the residuals."""


class Offered(NamedTuple):
    """A hypothesis that explains the observations much better than they are without it."""

    hypothesis: Hypothesis
    after: float
    """vᵀPv with the change."""
    freedom_after: int
    gain: float
    """By how much the description of the observations becomes shorter, in units of χ²."""
    amount: AddedParameter | None
    like_the_first: bool
    """True where the observations cannot tell it from the first one."""


class Before(NamedTuple):
    """vᵀPv without a hypothesis."""

    told: float
    """That of the plain adjustment, or of its last iteration; not finite where there was none."""
    compared: float
    """That which a hypothesis has to improve."""
    freedom: int


class Trial(NamedTuple):
    """A hypothesis that was adjusted."""

    hypothesis: Hypothesis
    fit: NetworkFit | None
    """``None`` if its adjustment has no solution."""
    gain: float
    """By how much the description of the observations becomes shorter, in units of χ²."""


class Diagnosis(NamedTuple):
    """Result of a search for mistakes."""

    before: Before
    offered: tuple[Offered, ...] = ()
    """Hypotheses that are better than none by more than chance, the best first."""
    trials: tuple[Trial, ...] = ()
    """All hypotheses that were adjusted, in their order."""
    untried: int = 0
    """Hypotheses that were not tried because the time was over."""


NOTHING_FOUND = Diagnosis(Before(float("nan"), float("nan"), 0))

GoOn = Callable[[Hypothesis], bool]
"""Called before each trial; False ends the search."""


def with_group(network: Network, number: int, group: ObservationGroup) -> Network:
    """The network with another group in the place of one."""
    groups = list(network.groups)
    groups[number] = group
    return replace(network, groups=tuple(groups))


def with_observed(network: Network, number: int, rows: IntArray, change: Callable[[FloatArray], FloatArray]) -> Network:
    """Return the network with changed observed values (k, m) of some rows of a group, and their faces.

    Of image coordinates the measured ones, before distortion, are changed as well.
    """
    group = network.groups[number]
    observed, constants = group.observed.copy(), group.constants.copy()
    observed[rows] = change(observed[rows])
    names = [constant.name for constant in group.type.constants]
    if group.type.tell_face is not None:
        constants[rows, names.index("face")] = group.type.tell_face(observed[rows, -1])
    if "measured x" in names:
        first = names.index("measured x")
        constants[rows, first : first + 2] = change(constants[rows, first : first + 2])
    return with_group(network, number, replace(group, observed=observed, constants=constants))


def frames_of(parts: Iterable[tuple[ObservationGroup, IntArray]]) -> dict[str, IntArray]:
    """Blocks by kind of the positions and rotations of the images or stations of some rows."""
    found: dict[str, list[IntArray]] = {}
    for group, rows in parts:
        for slot, blocks in group.blocks_by_slot:
            if slot.of == group.type.references[0].name and slot.part in ("position", "rotation"):
                found.setdefault(slot.kind, []).append(np.asarray(blocks[rows]))
    return {kind: np.unique(np.concatenate(blocks)) for kind, blocks in found.items()}


def with_blocks(network: Network, number: int, rows: Sequence[int], blocks: Mapping[int, Sequence[int]]) -> Network:
    """The network with other blocks in some slots (by number) of some rows of a group."""
    group = network.groups[number]
    changed = list(group.blocks)
    for slot, values in blocks.items():
        own = changed[slot].copy()
        own[list(rows)] = values
        changed[slot] = own
    return with_group(network, number, replace(group, blocks=tuple(changed)))


def with_unknown(
    network: Network, kind: str, value: FloatArray, free: BoolArray, like: int = -1
) -> tuple[Network, int]:
    """The network with one more block of a kind, whose components are ``free`` (size,), and its number.

    A rotation turns as the block ``like`` does.
    """
    blocks, number = network.blocks[kind], len(network.blocks[kind].ids)
    more = np.full((1, len(value)), number, dtype=np.int64)
    nothing = np.full((1, len(value)), np.nan)
    longer = blocks._replace(
        ids=(*blocks.ids, "hypothesis"),
        free=np.concatenate([blocks.free, free[None]]),
        owner=np.concatenate([blocks.owner, more]),
        about_axes=None if blocks.about_axes is None else np.append(blocks.about_axes, blocks.about_axes[like]),
        difference=None if blocks.difference is None else np.concatenate([blocks.difference, 0.0 * value[None]]),
    )
    return replace(
        network,
        blocks={**network.blocks, kind: longer},
        start={**network.start, kind: np.concatenate([network.start[kind], value[None]])},
        observed={**network.observed, kind: np.concatenate([network.observed[kind], nothing])},
        sigma={**network.sigma, kind: np.concatenate([network.sigma[kind], nothing])},
    ), number


def with_points(network: Network, points: IntArray, change: Callable[[FloatArray], FloatArray]) -> Network:
    """The network with the given coordinates (k, 3) of some points changed, observed ones as well as start values."""
    start = network.start["point"].copy()
    start[points] = change(start[points])
    network = replace(network, start={**network.start, "point": start})
    for number, group in enumerate(network.groups):
        if group.type.key not in OBSERVED_POINTS:
            continue
        place = np.full(len(start), -1)
        place[points] = np.arange(len(points))
        rows = np.flatnonzero(place[group.blocks[0]] >= 0)
        if len(rows) == 0:
            continue
        observed, sigma = group.observed.copy(), group.sigma.copy()
        whole = np.full((len(points), 3), np.nan)
        whole[place[group.blocks[0][rows]]] = observed[rows]
        moved = change(whole)[place[group.blocks[0][rows]]]
        same = np.isfinite(moved) == np.isfinite(observed[rows])
        if not same.all():
            continue  # what was observed of it is not the same components
        observed[rows] = moved
        network = with_group(network, number, replace(group, observed=observed, sigma=sigma))
    return network


# ---- The starting point of a search: the network, how its adjustment ended, and values at which most observations fit.

OBSERVED_POINTS = ("observed/point", "coordinates")
"""Types of observations of points themselves."""
SMALL = 20_000
"""Observations up to which graduated weights and intersections of single points take next to no time."""


Make = Callable[[Network, Values, Values], Problem]
Begin = Callable[[Network], Values | None]


@dataclass(frozen=True)
class Situation:
    """State of a network whose observations do not agree."""

    network: Network
    start: Values
    values: Values
    """Where most observations fit: the solution, or where graduated weights lead."""
    solution: Adjustment | None
    """The adjustment, where there is one; suspects may be left out of it."""
    make: Make
    begin: Begin
    unstarted: frozenset[str] = frozenset()
    """Names of things without start values: what refers to them does not fit, and there is no place where most fit."""

    settled: bool = True
    """False where the values are start values, and nothing is known of where most observations fit."""
    scored: tuple[ScoredHypothesis, ...] = ()
    """Possible causes by score tests of the solution, the best first."""
    larger: bool = True
    """False where all that is rejected is smaller than its σ says."""

    @cached_property
    def sizes(self) -> tuple[FloatArray, ...]:
        """|v|/σ (n, m) of every group, 0 where not observed; ∞ where start values are missing."""
        if self.unstarted:
            return tuple(np.where(self._concerned(group), np.inf, 0.0) for group in self.network.groups)
        groups = self.make(self.network, self.start, self.values).groups if self.settled else self.network.groups
        return sizes_of(groups, self.values)

    def _concerned(self, group: ObservationGroup) -> BoolArray:
        """(n, m) observations that refer to something without start values."""
        rows = np.zeros(group.count, dtype=bool)
        for column in group.references:
            rows |= np.array([name in self.unstarted for name in column], dtype=bool)
        return group.mask & rows[:, None]

    @property
    def begun(self) -> bool:
        """False where start values could not be worked out."""
        return not self.unstarted

    @cached_property
    def linearised(self) -> Adjustment:
        """The normal equations of all observations, suspects among them, where most of them fit.

        Raises :class:`InputError`, :class:`NotFiniteError` where an observation has no value there.
        """
        with np.errstate(all="ignore"):
            return adjust(self.make(self.network, self.values, self.values), self.values, SolverSettings(0))

    @cached_property
    def redundancy_numbers(self) -> tuple[FloatArray, ...] | None:
        """Redundancy numbers (n, m) of every group where most observations fit; nothing where that is not known."""
        if not self.settled:
            return None
        try:
            here = self.linearised
        except (InputError, NotFiniteError):
            return None
        return None if here.outcome is Outcome.SINGULAR else redundancy_numbers(here)

    @cached_property
    def redundancy_of_solution(self) -> tuple[FloatArray, ...] | None:
        """Redundancy numbers (n, m) of every group in the adjustment there is."""
        if self.solution is None:
            return None
        return redundancy_numbers(self.solution)

    @property
    def count(self) -> int:
        """Number of observations."""
        return self.network.observations

    def worst_rows(self, group: int, most: int) -> IntArray:
        """Rows of a group with an observation that does not fit beside the others, the worst first."""
        largest = self.sizes[group].max(axis=1, initial=0.0)
        order = np.argsort(-largest, kind="stable")[:most]
        return np.asarray(order[largest[order] > self.limit])

    @cached_property
    def limit(self) -> float:
        """|v|/σ beyond which an observation does not fit beside the others.

        In large networks few errors leave half of all residuals as they are: the median tells how large chance makes
        them. In small ones an error is in all residuals.
        """
        if self.count <= SMALL or not self.settled:
            return SUSPECT
        scale = robust_scales(self.make(self.network, self.start, self.values), self.sizes).overall
        return max(SUSPECT, scale * price_of_gross_error(self.count))

    @cached_property
    def misfitting(self) -> tuple[BoolArray, ...]:
        """(n, m) observations that do not fit."""
        return tuple(size > SUSPECT for size in self.sizes)

    @property
    def most_do_not_fit(self) -> bool:
        """True where half of all rows have an observation that does not fit."""
        pairs = zip(self.network.groups, self.misfitting, strict=False)
        return 2 * sum(int(bad.any(axis=1).sum()) for _, bad in pairs) > sum(g.count for g in self.network.groups)

    @cached_property
    def many_are_out(self) -> bool:
        """True if 3 rows and 5 % of a group, or all of it, are left out of the solution: no single mistake did that."""
        if self.solution is None:
            return False
        for group in self.solution.problem.groups:
            out, count = int(group.left_out.any(axis=1).sum()), group.count
            if out >= 3 and (out > 0.05 * count or out == count):
                return True
        return False

    @cached_property
    def something_is_wrong_as_a_whole(self) -> bool:
        """True where half of a group, of an image or of a station does not fit: only then a change of all of it may."""
        # Half of so many rows of an image or a station is more than chance.
        at_least = 3
        for group, bad in zip(self.network.groups, self.misfitting, strict=False):  # checks, left out, come last
            rows = bad.any(axis=1)
            if group.count >= at_least and 2 * np.count_nonzero(rows) >= group.count:
                return True
            whole = np.bincount(group.references[0].numbers)
            wrong = np.bincount(group.references[0].numbers, weights=rows, minlength=len(whole))
            if ((whole >= at_least) & (2 * wrong >= whole)).any():
                return True
        return False

    @cached_property
    def fit(self) -> NetworkFit:
        """Fit of the network as it is, at the solution where that is better described.

        At start values nothing fits yet: they are compared with a fit that leaves twice of what is expected, and with
        observations that refer to nothing as good as wrong.
        """
        if not self.settled:
            lost = sum(int(np.isinf(size).sum()) for size in self.sizes)
            length = 2.0 * self.count + lost * 2.0 * float(np.log(max(self.count, 2)))
            return NetworkFit(self.start, np.inf, 0, length, np.inf)
        places = [self.values] if self.solution is None else [self.values, self.solution.values]
        fits = (fit_of(self.make(self.network, v, v), v, self.defect, self.count) for v in places)
        return min(fits, key=lambda fit: fit.length)

    @property
    def defect(self) -> int:
        """Movements of the whole network that the observations leave free; 0 where that is not known."""
        return 0 if self.solution is None else self.solution.defect.dimension


def redundancy_numbers(adjustment: Adjustment) -> tuple[FloatArray, ...]:
    """Redundancy numbers (n, m) of every group, NaN where not observed or left out."""
    return tuple(group.r for group in assess(adjustment).groups)


def fit_of(problem: Problem, values: Values, defect: int, count: int, cost: float = 0.0) -> NetworkFit:
    """Fit of some values to the observations; ``cost`` is that of the choice of their model."""
    sizes = sizes_of(problem.groups, values)
    used = [size[~group.left_out] for size, group in zip(sizes, problem.groups, strict=True)]
    return NetworkFit(
        values,
        float(sum(np.sum(size**2) for size in used)),
        problem.observations - problem.index.count + defect,
        cost_of_residuals(used, count) + cost,
        factor_of_sigmas(used),
    )


def controlled_part(situation: Situation, changed: Network, after: Adjustment) -> float:
    """Mean redundancy number of the changed observations, where most fit without the change and with it; 1 of none."""
    masks = changed_observations(situation.network, changed)
    parts = [_mean(situation.redundancy_numbers, masks), _mean(redundancy_numbers(after), masks)]
    known = [part for part in parts if np.isfinite(part)]
    return float(np.mean(known)) if known else 1.0


def changed_observations(old: Network, new: Network) -> list[BoolArray]:
    """(n, m) observations of every group that have another value or σ than before."""
    pairs = zip(old.groups, new.groups, strict=True)
    return [a.mask & ((a.observed != b.observed) | (a.sigma != b.sigma)) for a, b in pairs]


def _mean(numbers: tuple[FloatArray, ...] | None, masks: list[BoolArray]) -> float:
    if numbers is None:
        return np.nan
    chosen = np.concatenate([r[mask] for r, mask in zip(numbers, masks, strict=False)])
    return float(np.nanmean(chosen)) if np.isfinite(chosen).any() else np.nan


class HopelessError(Exception):
    """An iteration that leads nowhere."""


def attempt(problem: Problem, begin: Values) -> Adjustment:
    """An adjustment that ends early where it leads nowhere.

    Raises:
        HopelessError: it does not come near to a solution as quickly as one that will.
    """
    with np.errstate(all="ignore"):
        return adjust(problem, begin, SolverSettings(15), _impatient())


def without_row(situation: Situation, group: int, row: int) -> Values:
    """Solution without a row, or the values that most observations fit if there is none."""
    problem = situation.make(situation.network, situation.start, situation.values)
    masks = [own.left_out.copy() for own in problem.groups]
    masks[group][row] = True
    try:
        found = attempt(exclude(problem, masks), situation.values)
    except (InputError, NotFiniteError, HopelessError):
        return situation.values
    return found.values if found.outcome.is_solution else situation.values


def _impatient() -> Watcher:
    """A watcher that ends an iteration which does not come near to a solution as quickly as one that will.

    That is one whose vᵀPv is not halved twice in a row, as long as it is far from what is expected.
    """
    seen: list[float] = []

    def watch(iteration: Iteration) -> None:
        seen.append(iteration.objective)
        last = seen[-3:]
        slow = len(last) > 2 and all(b > 0.5 * a for a, b in pairwise(last))
        if slow and iteration.objective > 25.0 * max(iteration.redundancy, 1) and iteration.largest_change > 1.0:
            raise HopelessError

    return watch
