#!/usr/bin/env python
"""Record what ``mor adjust`` does with many inputs, and compare two such records.

    python tools/snapshot.py make before.json.xz
    ... change the program ...
    python tools/snapshot.py make after.json.xz --inputs before.json.xz
    python tools/snapshot.py compare before.json.xz after.json.xz
    python tools/snapshot.py compare before.json.xz after.json.xz --round-off
    python tools/snapshot.py compare before.json.xz after.json.xz --bound 1e-9 '*:sigma0*=1e-12'
    python tools/snapshot.py compare before.json.xz after.json.xz --times
    python tools/snapshot.py make workers.json.xz --engine workers

``make`` runs each input in a folder of its own and stores the exit code, the messages, and every file that the program
writes. A snapshot also holds its inputs, so another state of the program can be run on exactly the same files
(``--inputs SNAPSHOT``, ``--tree FOLDER``). ``compare`` prints exit codes first, then messages, then texts, then
numbers, and exits with 1 if anything differs.

The inputs are in five groups, which ``--only`` selects:

samples   every project of sample_projects/, with the report as a page
cases     tests/cases: small inputs on which the program once failed
networks  tests/reference/networks: networks with known results
shared    the folders of ../shared/cases, if they exist
mutants   300 projects with random faults, made by tests/scenarios/mutations with the seed 37

``--engine workers`` has two processes do all passes over 30 image points or more. ``--engine memory`` keeps all arrays
of 100 numbers or more in files, of which nothing stays in memory. Both take eight points at a time, so that small
projects have several shards.

``report.html`` is written for the samples only, because it takes a quarter of the time and is drawn from the same
results. The snapshot holds its text, and a digest of the packed numbers of its pictures.
"""

from __future__ import annotations

import argparse
import contextlib
import csv
import difflib
import gc
import hashlib
import importlib
import io
import json
import lzma
import math
import os
import pkgutil
import re
import runpy
import shlex
import shutil
import signal
import statistics
import subprocess
import sys
import tempfile
import time
import warnings
from collections import Counter, defaultdict
from collections.abc import Iterator
from concurrent.futures import ThreadPoolExecutor
from fnmatch import fnmatchcase
from pathlib import Path
from queue import SimpleQueue
from typing import Any, NamedTuple

if sys.platform != "win32":
    import resource

ROOT = Path(__file__).resolve().parents[1]
GROUPS = ("samples", "cases", "networks", "shared", "mutants")
MUTANTS, SEED = 300, 37
DATE = "1767225600"
"""The date that all results carry: 2026-01-01, in seconds since 1970."""
OUTPUT = "out"
"""The folder of the results, beside the project."""
DATA = {".csv", ".stn", ".gtx", ".json"}
NO_PROJECTS = {*DATA, ".md", ".py", ".sh"}
"""Suffixes of files that a project beside them may read, and of all that are no projects."""
ENVIRONMENT = {
    **dict.fromkeys(("OPENBLAS_NUM_THREADS", "OMP_NUM_THREADS", "MKL_NUM_THREADS"), "1"),
    **dict.fromkeys(("VECLIB_MAXIMUM_THREADS", "NUMBA_NUM_THREADS", "POLARS_MAX_THREADS"), "1"),
    "SOURCE_DATE_EPOCH": DATE,
    "TZ": "UTC",
    "LC_ALL": "C.UTF-8",
    "PYTHONUTF8": "1",
    "COLUMNS": "100",
    "NO_COLOR": "1",
    "TERM": "dumb",
    "PYTHONSAFEPATH": "1",
}
"""One thread, one date and one terminal, so that the same state gives the same bytes."""
VOLATILE = (
    (r"\bmor \d+\.\d+\.\d+[\w.+]*", "mor VERSION", "the version of the program"),
    (r"\b(Python|numpy|scipy|numba|polars) \d+\.\d+[\w.]*", r"\1 VERSION", "versions of dependencies"),
    (r"(?<![\w.-])\d+(\.\d+)? [GM]B\b", "MEMORY", "memory that the machine has, or that a run needs"),
    (r"\b(after|in|took) \d+(\.\d+)? s\b", r"\1 DURATION", "durations"),
    (r"(?m)^note: compiling the kernels.*\n", "", "whether compiled code is in the cache"),
    (r", line \d+, in ", ", line LINE, in ", "lines of the program in tracebacks"),
)
"""What is replaced in every text before two snapshots are compared: pattern, replacement, what it is.
Paths are replaced when a run is stored (FOLDER, TREE, PYTHON); dates are fixed by the environment of the run."""

SHARDS = {"mor.solve.rays": {"POINTS_AT_A_TIME": 8, "RAYS_AT_A_TIME": 64}}
ENGINES: dict[str, dict[str, dict[str, float]]] = {
    "threads": {},
    "workers": {**SHARDS, "mor.solve.engine": {"WORTH_SENDING": 30}},
    "memory": {**SHARDS, "mor.long_arrays": {"LONG": 800, "_SHARE": 0.0, "_WORTH": -1e12, "_PAUSE": 0.001}},
}
"""What an engine changes in modules, so that it is used for small projects."""

ROUND_OFF = ["1e-6", "1e-6sigma", "1e-7column", "1e-10abs"]
"""Bounds of ``--round-off``. Two kinds of processors (OPENBLAS_CORETYPE) stay within them on all samples, with two
exceptions among the small cases: a free network whose first frame is ambiguous, and a test value of 3e7."""
ITERATIONS = "results.json:iteration_log*"
"""What ``--round-off`` leaves out: a last step of 1e-10 sigma is nothing but round-off."""


class Input(NamedTuple):
    """One project and how it is adjusted."""

    name: str
    main: str
    options: list[str]
    files: dict[str, bytes]


# --- Inputs ---


def inputs_of(root: Path, shared: Path, patterns: list[str]) -> list[Input]:
    """Return the inputs of a working tree that the patterns select."""
    found: list[Input] = []
    wanted = [group for group in GROUPS if any(p.split("/")[0] in (group, "*") for p in patterns)]
    if "samples" in wanted:
        found += _projects("samples", root / "sample_projects", ["--html"], only="project.yaml")
    if "cases" in wanted:
        found += _projects("cases", root / "tests" / "cases")
    if "networks" in wanted:
        found += _projects("networks", root / "tests" / "reference" / "networks")
    if "shared" in wanted and shared.is_dir():
        found += _projects("shared", shared)
    if "mutants" in wanted:
        found += _mutants(root)
    return [given for given in found if _selected(given.name, patterns)]


def _selected(name: str, patterns: list[str]) -> bool:
    return any(fnmatchcase(name, p) or fnmatchcase(name, f"{p}/*") for p in patterns)


def _projects(group: str, top: Path, options: list[str] | None = None, only: str = "") -> Iterator[Input]:
    """Yield the projects below a folder: single files, and in folders files with the tables beside them."""
    skipped, with_project = [], set()
    for main in sorted(path for path in top.rglob(only or "*") if path.is_file()):
        inside = main.relative_to(top)
        if any(part.endswith(".results") or part in ("truth", "__pycache__") for part in inside.parts):
            continue
        if main.suffix in NO_PROJECTS or main.stem in ("README", "SOURCE", "expected"):
            skipped.append(main)
            continue
        beside = [main]
        if main.parent != top:
            beside += [p for p in sorted(main.parent.rglob("*")) if p.suffix in DATA and "truth" not in p.parts]
        files = {p.relative_to(main.parent).as_posix(): p.read_bytes() for p in beside if not _is_result(p)}
        name = inside.parent if main.name == "project.yaml" else inside
        with_project.add(main.parent)
        yield Input(f"{group}/{name.as_posix()}", main.name, options or ["--no-html"], files)
    alone = sorted({path.relative_to(top).as_posix() for path in skipped if path.parent not in with_project})
    if alone:
        print(f"{group}: {len(alone)} files without a project are not run: {', '.join(alone)}", file=sys.stderr)


def _is_result(path: Path) -> bool:
    return path.name.endswith("expected.json") or any(part.endswith(".results") for part in path.parts)


def _mutants(root: Path) -> Iterator[Input]:
    """Yield the mutants; those that would be checked or converted are adjusted as well."""
    sys.path[:0] = [str(root), str(root / "tests")]
    from tests.scenarios.mutations.material import all_material  # type: ignore[import-untyped]
    from tests.scenarios.mutations.mutant import mutant  # type: ignore[import-untyped]

    materials = all_material()
    for number in range(MUTANTS):
        made = mutant(materials, SEED, number)
        options = [option for option in made.command[1:] if option in ("--lang", "de", "--snoop", "--strict")]
        yield Input(f"mutants/{number:03d}", made.main, ["--no-html", *options], made.files)


# --- Making a snapshot ---


def make(out: Path, given: list[Input], header: dict[str, Any], settings: argparse.Namespace) -> None:
    """Run all inputs and write the snapshot."""
    before = load(out) if settings.add else {"header": {"only": []}, "contents": {}, "runs": {}}
    runs: dict[str, dict[str, Any]] = before["runs"]
    header["only"] = sorted({*before["header"]["only"], *header["only"]})
    contents = before["contents"] | {
        _digest(content): _text(content) for each in given for content in each.files.values()
    }
    starters: SimpleQueue[Starter] = SimpleQueue()
    with (
        _engine(settings.engine, settings.tree) as options,
        tempfile.TemporaryDirectory(prefix="snapshot") as place,
        ThreadPoolExecutor(max_workers=settings.jobs) as pool,
    ):
        for _ in range(min(settings.jobs, len(given))):
            starters.put(Starter(settings))
        tasks = [pool.submit(_run, Path(place) / str(i), each, options, starters) for i, each in enumerate(given)]
        for number, (each, task) in enumerate(zip(given, tasks, strict=True), 1):
            runs[each.name] = task.result()
            print(
                f"{number}/{len(given)} {each.name}: {runs[each.name]['outcome']}",
                file=sys.stderr,
                flush=True,
            )
        while not starters.empty():
            starters.get().close()
    with lzma.open(out, "wt", preset=1, encoding="ascii") as file:
        json.dump({"header": header, "contents": contents, "runs": runs}, file)
    codes = Counter(str(record["outcome"]) for record in runs.values())
    seconds = sum(record["seconds"] for record in runs.values())
    print(f"{out}: {len(runs)} runs, {seconds:.0f} CPU-s; outcomes {_counted(codes)}", file=sys.stderr)


@contextlib.contextmanager
def _engine(name: str, tree: Path) -> Iterator[list[str]]:
    """Yield the options of an engine; two workers of a tree run as long."""
    if name != "workers":
        yield ["--memory", "8GB"] if name == "memory" else []
        return
    command = [sys.executable, __file__, "cluster"]
    with subprocess.Popen(
        command, env=_environment(tree), stdin=subprocess.PIPE, stdout=subprocess.PIPE, text=True
    ) as cluster:
        assert cluster.stdout is not None
        yield ["--cluster", cluster.stdout.readline().strip()]
        cluster.communicate()


def serve_cluster() -> None:
    """Start two workers and print the address of their scheduler; end with the standard input."""
    import dask
    from distributed import LocalCluster

    dask.config.set({"distributed.worker.profile.enabled": False, "distributed.admin.tick.interval": "1s"})
    with LocalCluster(n_workers=2, threads_per_worker=1, dashboard_address=":0") as cluster:  # type: ignore[no-untyped-call]
        print(cluster.scheduler_address, flush=True)
        sys.stdin.read()


def _environment(tree: Path) -> dict[str, str]:
    kept = {k: v for k, v in os.environ.items() if not k.startswith(("MOR_", "PYTHON", "LANG"))}
    return {**kept, **ENVIRONMENT, "PYTHONPATH": str(tree)}


def _run(folder: Path, given: Input, engine: list[str], starters: SimpleQueue[Starter]) -> dict[str, Any]:
    """Run one input in a new folder; return the record of the snapshot."""
    work = folder / "work"
    for name, content in given.files.items():
        path = work / name
        path.parent.mkdir(parents=True, exist_ok=True)
        path.write_bytes(content)
    starter = starters.get()
    try:
        options = [*given.options, *engine]
        outcome, seconds = starter.run(work, ["adjust", given.main, "-o", OUTPUT, "--tables", "all", *options])
    finally:
        starters.put(starter)
    paths = [(str(path), word) for path, word in _paths(work, starter.tree)]
    written = {}
    for path in sorted(work.rglob("*")):
        name = path.relative_to(work).as_posix()
        if path.is_file() and (content := path.read_bytes()) != given.files.get(name):
            written[name] = _page(content) if path.suffix == ".html" else _without_paths(content, paths)
    for name in given.files:
        if not (work / name).is_file():
            written[name] = "(the program deleted this input)"
    said = {stream: _without_paths((folder / stream).read_bytes(), paths) for stream in ("stdout", "stderr")}
    shutil.rmtree(folder)
    return {
        "main": given.main,
        "options": given.options,
        "inputs": {name: _digest(content) for name, content in given.files.items()},
        "outcome": outcome,
        "seconds": seconds,
        **said,
        "files": written,
    }


class Starter:
    """Starts runs one after the other: forks of a process that has all modules of mor loaded, or new processes.

    Loading takes two seconds, ten times as long as most adjustments.
    """

    def __init__(self, settings: argparse.Namespace) -> None:
        self.tree: Path = settings.tree
        self._command: list[str] = shlex.split(settings.mor) or [sys.executable, "-m", "mor"]
        self._limit: float = settings.limit
        self._environment = _environment(settings.tree)
        self._forking = None
        if not settings.mor and hasattr(os, "fork"):
            self._forking = subprocess.Popen(
                [sys.executable, __file__, "serve", settings.engine],
                env=self._environment,
                stdin=subprocess.PIPE,
                stdout=subprocess.PIPE,
                text=True,
            )

    def run(self, work: Path, arguments: list[str]) -> tuple[int | str, float]:
        """Run mor in a folder; return its exit code or "time limit", and its CPU time (elapsed time on Windows)."""
        if self._forking:
            assert self._forking.stdin is not None
            assert self._forking.stdout is not None
            self._forking.stdin.write(json.dumps([str(work), arguments, self._limit]) + "\n")
            self._forking.stdin.flush()
            answer = self._forking.stdout.readline()
            if not answer:
                raise SystemExit(f"The process that starts mor ended with {self._forking.wait()}.")
            outcome, seconds = json.loads(answer)
            return outcome, seconds
        with (work.parent / "stdout").open("wb") as out, (work.parent / "stderr").open("wb") as err:
            process = subprocess.Popen(
                [*self._command, *arguments],
                cwd=work,
                env=self._environment,
                stdin=subprocess.DEVNULL,
                stdout=out,
                stderr=err,
            )
            if hasattr(os, "wait4"):
                outcome, seconds = _wait(process.pid, self._limit)
                process.returncode = 0  # it has been waited for
                return outcome, seconds
            began = time.monotonic()
            try:
                return process.wait(self._limit), time.monotonic() - began
            except subprocess.TimeoutExpired:
                process.kill()
                process.wait()
                return "time limit", self._limit

    def close(self) -> None:
        """End the process that forks."""
        if self._forking:
            self._forking.communicate()


def serve(engine: str) -> None:
    """Load mor, set an engine, and run each command of standard input in a fork; answer with outcome and time."""
    import mor

    for module in pkgutil.walk_packages(mor.__path__, "mor."):
        if not module.name.endswith("__main__"):
            with contextlib.suppress(ImportError):  # an optional dependency is missing
                importlib.import_module(module.name)
    for name, values in ENGINES[engine].items():
        vars(importlib.import_module(name)).update(values)
    gc.freeze()
    for line in sys.stdin:
        work, arguments, limit = json.loads(line)
        with warnings.catch_warnings():
            warnings.simplefilter("ignore")  # of forks: the threads of Polars wait
            pid = os.fork()
        if pid == 0:
            os.chdir(work)
            streams = (("/dev/null", os.O_RDONLY), ("../stdout", _NEW), ("../stderr", _NEW))
            for number, (name, flags) in enumerate(streams):
                os.dup2(os.open(name, flags, 0o600), number)
            sys.stdin = open(0, closefd=False)  # noqa: SIM115 - until the process ends
            sys.argv = ["mor", *arguments]
            runpy.run_module("mor", run_name="__main__", alter_sys=True)
            return
        print(json.dumps(_wait(pid, limit)), flush=True)


_NEW = os.O_WRONLY | os.O_CREAT | os.O_TRUNC


def _wait(pid: int, limit: float) -> tuple[int | str, float]:
    """Wait for a process; return its exit code or "time limit", and its CPU time."""
    began, killed = time.monotonic(), False
    if sys.platform == "linux":  # elsewhere ten times as long on the clock
        resource.prlimit(pid, resource.RLIMIT_CPU, (math.ceil(limit), math.ceil(limit) + 1))
    while True:
        found, status, usage = os.wait4(pid, os.WNOHANG)
        if found:
            code = os.waitstatus_to_exitcode(status)
            late = killed or code == -signal.SIGXCPU
            return "time limit" if late else code, usage.ru_utime + usage.ru_stime
        if not killed and time.monotonic() - began > 10.0 * limit:
            os.kill(pid, signal.SIGKILL)
            killed = True
        time.sleep(0.005)


def _paths(work: Path, tree: Path) -> list[tuple[Path, str]]:
    places = [
        (work, "FOLDER"),
        (tree, "TREE"),
        (Path(sys.prefix), "PYTHON"),
        (Path(sys.base_prefix), "PYTHON"),
    ]
    return [*((path.resolve(), word) for path, word in places), *places]


def _without_paths(content: bytes, paths: list[tuple[str, str]]) -> str:
    text = _text(content).replace("\r\n", "\n")
    for path, word in paths:
        text = text.replace(path, word)
    return text


def _page(content: bytes) -> str:
    """Return the text of a page, and a digest of its packed numbers; other scripts are left out."""
    text = _text(content)
    packed = re.search(r'<script[^>]* id="payload">(.*?)</script>', text, re.DOTALL)
    digest = _digest(packed[1].encode()) if packed else "none"
    return f"digest of the pictures: {digest}\n" + re.sub(r"<script.*?</script>", "", text, flags=re.DOTALL)


def _text(content: bytes) -> str:
    return content.decode("utf-8", "surrogateescape")


def _digest(content: bytes) -> str:
    return hashlib.sha256(content).hexdigest()[:20]


def _counted(counter: Counter[str]) -> str:
    return ", ".join(f"{name}: {count}" for name, count in sorted(counter.items()))


# --- Reading a snapshot ---


def load(path: Path) -> dict[str, Any]:
    """Read a snapshot. Raises SystemExit if the file is not one."""
    try:
        with lzma.open(path, "rt", encoding="ascii") as file:
            content: dict[str, Any] = json.load(file)
        content["header"], content["contents"], content["runs"]
    except (OSError, lzma.LZMAError, ValueError, KeyError, TypeError) as error:
        raise SystemExit(f"{path}: not a snapshot ({error}). Write one with `make`.") from None
    return content


def stored_inputs(snapshot: dict[str, Any], patterns: list[str]) -> list[Input]:
    """Return the inputs that a snapshot holds, as far as the patterns select them."""
    contents = {digest: text.encode("utf-8", "surrogateescape") for digest, text in snapshot["contents"].items()}
    return [
        Input(name, run["main"], run["options"], {file: contents[d] for file, d in run["inputs"].items()})
        for name, run in snapshot["runs"].items()
        if _selected(name, patterns)
    ]


def stable(text: str) -> str:
    """Return a text without what changes from run to run (VOLATILE)."""
    for pattern, replacement, _ in VOLATILE:
        text = re.sub(pattern, replacement, text)
    return text


# --- Bounds ---


class Bound(NamedTuple):
    """How far the numbers of some columns may differ: fits FILE:COLUMN, amounts by their kind."""

    pattern: str
    amounts: list[tuple[float, str]]


def parsed_bounds(words: list[str]) -> list[Bound]:
    """Return the bounds that the words of ``--bound`` state. Raises SystemExit if one is malformed."""
    bounds: list[Bound] = []
    for word in words:
        pattern, given, amounts = word.rpartition("=")
        terms = []
        for amount in amounts.split(","):
            found = re.fullmatch(r"(\d[\d.]*(?:e[-+]?\d+)?)(sigma|abs|column|)", amount)
            if not found:
                raise SystemExit(
                    f"--bound {word}: found {amount!r}, expected a number, alone or with sigma, abs or column."
                )
            terms.append((float(found[1]), found[2]))
        if not given and bounds and bounds[-1].pattern == "*":
            bounds[-1].amounts.extend(terms)
        else:
            bounds.append(Bound(pattern if given else "*", terms))
    return bounds


def _amounts(bounds: list[Bound], column: str) -> list[tuple[float, str]]:
    fitting = [bound.amounts for bound in bounds if fnmatchcase(column, bound.pattern)]
    return fitting[-1] if fitting else []


# --- Comparing ---


class Cell(NamedTuple):
    """A value of a file, and the standard deviation that stands beside it."""

    column: str
    value: Any
    sigma: float | None


class Difference(NamedTuple):
    """One difference of a run: which section it stands in, where it is, and both values."""

    section: str
    run: str
    place: str
    row: str
    old: str
    new: str
    size: float = 0.0


SECTIONS = ("runs", "inputs", "exit codes", "messages", "files", "rows", "texts", "numbers")
NAMES = (
    *("id", "name", "point", "image", "camera", "station", "parameter", "epoch", "type", "group", "at"),
    *("from", "to", "component", "file", "number"),
)
"""Columns and keys that say what a row is about; rows with the same names are compared."""


def differences(a: dict[str, Any], b: dict[str, Any], bounds: list[Bound], ignored: list[str]) -> list[Difference]:
    """Return all differences between two snapshots, in the order in which they are shown."""
    found: list[Difference] = []
    patterns = [snapshot["header"].get("only", ["*"]) for snapshot in (a, b)]
    names = [name for name in {**a["runs"], **b["runs"]} if all(_selected(name, p) for p in patterns)]
    for name in names:
        if name not in a["runs"] or name not in b["runs"]:
            there = [("run" if name in s["runs"] else "no run") for s in (a, b)]
            found.append(Difference("runs", name, "", "", there[0], there[1]))
            continue
        old, new = a["runs"][name], b["runs"][name]
        given = [{"command": [r["main"], *r["options"]], **r["inputs"]} for r in (old, new)]
        for file in sorted({**given[0], **given[1]}):
            if given[0].get(file) != given[1].get(file):
                states = [str(g.get(file, "none")) for g in given]
                found.append(Difference("inputs", name, file, "", states[0], states[1]))
        if old["outcome"] != new["outcome"]:
            found.append(Difference("exit codes", name, "", "", str(old["outcome"]), str(new["outcome"]), 0.0))
        for stream in ("stdout", "stderr"):
            found += _texts("messages", name, stream, old[stream], new[stream], bounds, ignored)
        for file in sorted({**old["files"], **new["files"]}):
            if file not in old["files"] or file not in new["files"]:
                there = ["written" if file in r["files"] else "not written" for r in (old, new)]
                found.append(Difference("files", name, file, "", there[0], there[1]))
            elif old["files"][file] != new["files"][file]:
                found += _files(name, file, old["files"][file], new["files"][file], bounds, ignored)
    return sorted(found, key=lambda difference: SECTIONS.index(difference.section))


def _files(run: str, file: str, old: str, new: str, bounds: list[Bound], ignored: list[str]) -> list[Difference]:
    """Return the differences of a file: cell by cell for tables and JSON, line by line for anything else."""
    short = file.removeprefix(f"{OUTPUT}/")
    read = {".json": _json_cells, ".csv": _table_cells}.get(Path(file).suffix)
    old, new = stable(old), stable(new)
    if read:
        try:
            cells = read(old), read(new)
        except ValueError:
            read = None
    if not read:
        return list(_texts("texts", run, short, old, new, bounds, ignored))
    found = list(_cells(run, short, *cells, bounds, ignored))
    if not found and not bounds and not ignored and old != new:
        found = [Difference("texts", run, short, "", "same values", "written in another form or order")]
    return found


def _table_cells(text: str) -> dict[tuple[str, str], Cell]:
    """Return the cells of a CSV table by row and column."""
    rows = list(csv.reader(io.StringIO(text)))
    if not rows:
        return {}
    header, cells, seen = rows[0], {("", ""): Cell("", ",".join(rows[0]), None)}, Counter[str]()
    for row in rows[1:]:
        record = dict(zip(header, row, strict=False))
        label = _label(record, seen)
        cells |= {(label, c): Cell(c, value, _sigma(record, c)) for c, value in record.items()}
    return cells


def _json_cells(text: str) -> dict[tuple[str, str], Cell]:
    """Return the numbers and texts of a JSON document by record and path."""
    cells: dict[tuple[str, str], Cell] = {}

    def walk(node: Any, row: str, column: str, beside: dict[str, Any]) -> None:
        if isinstance(node, dict):
            for key, value in node.items():
                walk(value, row, f"{column}.{key}" if column else key, node)
        elif isinstance(node, list):
            cells[row, f"{column}.length"] = Cell(f"{column}.length", len(node), None)
            seen = Counter[str]()
            for number, value in enumerate(node):
                label = _label(value, seen) if isinstance(value, dict) else f"[{number}]"
                walk(value, f"{row} {label}".strip(), column, beside)
        else:
            cells[row, column] = Cell(column, node, _sigma(beside, column.rpartition(".")[2]))

    walk(json.loads(text), "", "", {})
    return cells


def _label(record: dict[str, Any], seen: Counter[str]) -> str:
    """Return the name of a row from the names in it; rows of the same name are numbered."""
    words = [str(record[name]) for name in NAMES if isinstance(record.get(name), str | int) and record[name] != ""]
    label = " ".join(words)
    seen[label] += 1
    return f"{label} ({seen[label]})".strip() if seen[label] > 1 or not label else label


def _sigma(record: dict[str, Any], column: str) -> float | None:
    """Return the standard deviation that a row states for a value."""
    others = ("sigma_adjusted", "sigma") if column in ("observed", "adjusted", "v", "value") else ()
    for name in (f"s{column}", f"sigma_{column}", *others):
        if name in record and name != column:
            value = _number(record[name])
            if value is not None and value > 0.0:
                return value
    return None


def _number(value: Any) -> float | None:
    if isinstance(value, bool) or value is None:
        return None
    try:
        return float(value)
    except (TypeError, ValueError):
        return None


def _cells(
    run: str,
    file: str,
    old: dict[tuple[str, str], Cell],
    new: dict[tuple[str, str], Cell],
    bounds: list[Bound],
    ignored: list[str],
) -> Iterator[Difference]:
    largest: dict[str, float] = defaultdict(float)
    for cell in old.values():
        number = _number(cell.value)
        if number is not None and math.isfinite(number):
            largest[cell.column] = max(largest[cell.column], abs(number))
    for key in {**old, **new}:
        row, column = key
        place = f"{file}:{column}"
        if any(fnmatchcase(place, pattern) for pattern in ignored):
            continue
        if key not in old or key not in new:
            there = ["none" if key not in cells else str(cells[key].value) for cells in (old, new)]
            yield Difference("rows", run, place, row, there[0], there[1])
            continue
        a, b = old[key].value, new[key].value
        if a == b or (a != a and b != b):  # equal, or both not a number
            continue
        numbers = _number(a), _number(b)
        if None in numbers:
            yield Difference("texts", run, place, row, str(a), str(b), 0.0)
            continue
        x, y = float(numbers[0] or 0.0), float(numbers[1] or 0.0)
        sigma = old[key].sigma
        if not _within(x, y, sigma, largest[column], _amounts(bounds, place)):
            yield Difference("numbers", run, place, row, str(a), str(b), _relative(x, y))


def _within(x: float, y: float, sigma: float | None, largest: float, amounts: list[tuple[float, str]]) -> bool:
    """Return whether two numbers differ by no more than one of the amounts."""
    if not (math.isfinite(x) and math.isfinite(y)):
        return bool(amounts) and (x == y or (math.isnan(x) and math.isnan(y)))
    unit = {"": max(abs(x), abs(y)), "abs": 1.0, "column": largest, "sigma": sigma or 0.0}
    return any(abs(x - y) <= amount * unit[kind] for amount, kind in amounts)


def _relative(x: float, y: float) -> float:
    largest = max(abs(x), abs(y))
    return abs(x - y) / largest if largest > 0.0 and math.isfinite(largest) else math.inf


NUMBER = re.compile(r"(?<![\w.])[-+−]?\d+(?:\.\d+)?(?:e[-+−]?\d+)?(?![\w])", re.IGNORECASE)
"""A number in a text, also with the minus of a page."""


def _texts(
    section: str, run: str, place: str, old: str, new: str, bounds: list[Bound], ignored: list[str]
) -> Iterator[Difference]:
    """Yield the lines that differ. With bounds, a number may differ by one unit of its last digit, too."""
    if old == new or any(fnmatchcase(f"{place}:", pattern) for pattern in ignored):
        return
    lines = [stable(text).splitlines() for text in (old, new)]
    if bounds:
        lines = [[line for line in part if not line.startswith("digest of the pictures")] for part in lines]
    shapes = [[re.sub(r"[-−\s]+", " ", NUMBER.sub("#", line)) if bounds else line for line in part] for part in lines]
    matcher = difflib.SequenceMatcher(None, shapes[0], shapes[1], autojunk=False)
    for operation, i, k, j, m in matcher.get_opcodes():
        if operation == "equal":
            for number, (a, b) in enumerate(zip(lines[0][i:k], lines[1][j:m], strict=True), i + 1):
                if a != b and not _same_numbers(a, b, _amounts(bounds, f"{place}:")):
                    yield Difference(section, run, place, f"line {number}", a, b, 0.0)
        else:
            pairs = max(k - i, m - j)
            for n in range(pairs):
                a, b = (lines[0][i + n] if i + n < k else ""), (lines[1][j + n] if j + n < m else "")
                yield Difference(section, run, place, f"line {min(i + n, k) + 1}", a, b, 0.0)


def _same_numbers(a: str, b: str, amounts: list[tuple[float, str]]) -> bool:
    pairs = ([number.replace("−", "-") for number in NUMBER.findall(line)] for line in (a, b))
    for x, y in zip(*pairs, strict=True):
        digits = max(_last_digit(x), _last_digit(y)) * (1.0 + 1e-6)
        if x != y and not _within(float(x), float(y), None, 0.0, [*amounts, (digits, "abs")]):
            return False
    return True


def _last_digit(text: str) -> float:
    mantissa, _, exponent = text.lower().partition("e")
    if "." not in mantissa and not exponent:
        return 0.0  # a count
    return float(10.0 ** (int(exponent or 0) - len(mantissa.partition(".")[2])))


# --- Showing ---


def show(found: list[Difference], most: int) -> None:
    """Print differences by section; those of one run and column together."""
    for section in SECTIONS:
        here = [difference for difference in found if difference.section == section]
        if not here:
            continue
        runs = len({difference.run for difference in here})
        print(f"\n{section.capitalize()}: {len(here)} in {runs} run{'s' * (runs > 1)}")
        places: dict[tuple[str, str], list[Difference]] = defaultdict(list)
        for difference in here:
            places[difference.run, difference.place].append(difference)
        for shown, ((run, place), group) in enumerate(places.items()):
            if shown == most:
                print(f"  ... and {sum(map(len, list(places.values())[most:]))} more (--most shows more)")
                break
            _show_group(section, run, place, group)


def _show_group(section: str, run: str, place: str, group: list[Difference]) -> None:
    head = f"  {run} {place}".rstrip()
    if section in ("runs", "inputs", "exit codes", "files"):
        print(f"{head}: {_short(group[0].old)} -> {_short(group[0].new)}")
    elif section == "numbers":
        worst = max(group, key=lambda difference: difference.size)
        print(
            f"{head}: {len(group)} differ, at most by {worst.size:.1e} of the value; "
            f"{worst.row or 'value'}: {worst.old} -> {worst.new}"
        )
    else:
        print(f"{head}: {len(group)} differ")
        for difference in group[:3]:
            print(f"    {_short(difference.row, 60)}")
            print(f"      - {_short(difference.old)}")
            print(f"      + {_short(difference.new)}")


def _short(text: str, most: int = 160) -> str:
    shown = text.encode("utf-8", "backslashreplace").decode()
    return shown if len(shown) <= most else shown[: most - 3] + "..."


def show_times(a: dict[str, Any], b: dict[str, Any]) -> None:
    """Print the ratio of CPU times, new to old: by group the median, and the ten worst runs."""
    common = [name for name in a["runs"] if name in b["runs"]]
    seconds = {name: (a["runs"][name]["seconds"], b["runs"][name]["seconds"]) for name in common}
    ratios = {name: new / old for name, (old, new) in seconds.items() if old > 0.0}
    print(f"\n{'CPU time':24} {'runs':>5} {'old [s]':>9} {'new [s]':>9} {'median':>7} {'worst':>7}")
    for group in (*GROUPS, "all"):
        names = [name for name in ratios if group in ("all", name.split("/")[0])]
        if names:
            old, new = (sum(seconds[name][i] for name in names) for i in (0, 1))
            those = [ratios[name] for name in names]
            print(f"{group:24} {len(names):5} {old:9.1f} {new:9.1f} {statistics.median(those):7.2f} {max(those):7.2f}")
    print("\nThe ten worst ratios")
    for name in sorted(ratios, key=ratios.__getitem__, reverse=True)[:10]:
        print(f"{name:50} {seconds[name][0]:9.2f} {seconds[name][1]:9.2f} {ratios[name]:7.2f}")


# --- Command line ---


def main(arguments: list[str] | None = None) -> int:
    """Run the command line; return the exit code."""
    parser = argparse.ArgumentParser(
        prog="snapshot.py", description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    commands = parser.add_subparsers(dest="command", required=True)
    making = commands.add_parser("make", help="run all inputs and write a snapshot")
    making.add_argument("out", type=Path, nargs="?", default=Path("snapshot.json.xz"), help="file to write")
    making.add_argument(
        "--mor",
        default="",
        help='command to start anew for each run, such as "python -m mor" (default: forks of one process)',
    )
    making.add_argument("--only", default="*", help="groups or patterns of runs, with commas: samples,mutants/00*")
    making.add_argument("--add", action="store_true", help="keep the other runs that the file already has")
    making.add_argument("--jobs", type=int, default=os.cpu_count() or 1, help="runs at a time")
    making.add_argument("--engine", choices=ENGINES, default="threads", help="what does the passes over image points")
    making.add_argument("--limit", type=float, default=120.0, help="CPU seconds that a run may take")
    making.add_argument("--tree", type=Path, default=ROOT, help="folder with the state of mor to run")
    making.add_argument(
        "--inputs", type=Path, default=ROOT, help="folder with the inputs, or a snapshot that holds them"
    )
    making.add_argument("--with-shared", type=Path, help="folder of further cases (default: ../shared/cases)")
    comparing = commands.add_parser("compare", help="show what differs between two snapshots")
    comparing.add_argument("old", type=Path)
    comparing.add_argument("new", type=Path)
    comparing.add_argument(
        "--bound",
        nargs="+",
        default=[],
        metavar="[FILE:COLUMN=]AMOUNT",
        help="how far numbers may differ: 1e-9 (of the value), 1e-6sigma (of the standard deviation in its row), "
        "1e-12abs, 1e-9column (of the largest value of the column); with commas any of several; the last pattern "
        "that fits counts. Without --bound every byte counts",
    )
    comparing.add_argument(
        "--round-off",
        action="store_true",
        help=f"bounds that round-off alone does not exceed: {' '.join(ROUND_OFF)}, without the log of iterations",
    )
    comparing.add_argument(
        "--ignore", nargs="+", default=[], metavar="FILE:COLUMN", help="numbers and texts to leave out"
    )
    comparing.add_argument("--only", default="*", help="groups or patterns of runs, with commas")
    comparing.add_argument("--most", type=int, default=20, help="places to show in each section")
    comparing.add_argument("--times", action="store_true", help="also show the ratio of CPU times")
    settings = parser.parse_args(arguments)
    patterns = settings.only.split(",")
    if settings.command == "make":
        if settings.mor and settings.engine != "threads":
            parser.error("--engine needs forks: leave out --mor")
        settings.tree = settings.tree.absolute()
        if settings.inputs.is_dir():
            shared = settings.with_shared or settings.inputs.resolve().parent / "shared" / "cases"
            given = inputs_of(settings.inputs.resolve(), shared, patterns)
        else:
            given = stored_inputs(load(settings.inputs), patterns)
        if not given:
            raise SystemExit(f"--only {settings.only}: selects no input. Groups are {', '.join(GROUPS)}.")
        make(settings.out, given, {"only": patterns, "mutants": MUTANTS, "seed": SEED}, settings)
        return 0
    snapshots = load(settings.old), load(settings.new)
    for snapshot in snapshots:
        snapshot["runs"] = {n: run for n, run in snapshot["runs"].items() if _selected(n, patterns)}
    bounds, ignored = settings.bound, settings.ignore
    if settings.round_off:
        bounds, ignored = [*ROUND_OFF, *bounds], [ITERATIONS, *ignored]
    found = differences(*snapshots, parsed_bounds(bounds), ignored)
    show(found, settings.most)
    if settings.times:
        show_times(*snapshots)
    compared = len(snapshots[0]["runs"].keys() & snapshots[1]["runs"].keys())
    counts = Counter(difference.section for difference in found)
    told = ", ".join(f"{counts[section]} {section}" for section in SECTIONS if counts[section])
    print(f"\n{compared} runs compared. " + (f"Different: {told}." if found else "No differences."))
    return int(bool(found))


if __name__ == "__main__":
    if sys.argv[1:2] == ["serve"]:
        serve(sys.argv[2])
    elif sys.argv[1:] == ["cluster"]:
        serve_cluster()
    else:
        sys.exit(main())
