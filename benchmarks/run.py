"""Time mor and its peers on the same data, one after the other in one run, and print the ratios.

    python benchmarks/run.py [CASE …]       the usual cases when none are named; --list names all
    python benchmarks/run.py --page docs/benchmarks.md     put the tables into the page

Every measurement runs in a fresh process. Only the standard library is imported here: see ``measure.run``.
"""

from __future__ import annotations

import argparse
import json
import os
import platform
import shutil
import sys
import tempfile
from pathlib import Path
from typing import Any

from cases import CASES, Case
from gama import LIMIT, adjust_by_gama, available_gama
from measure import Run, run
from peers import ONE_THREAD, NotAvailableError, adjust_by_ceres, compile_ceres, covariance_by_pycolmap
from tables import markdown, plain

_TASK = Path(__file__).parent / "task.py"
_ROOT = Path(__file__).parents[1]
_BEGIN, _END = "<!-- tables by benchmarks/run.py -->", "<!-- end of the tables -->"

GAMA_DIGITS = 1e-4
"""Part of σ0 by which gama-local may differ: it ends its iterations earlier, and writes fewer digits."""

Variant = tuple[str, str, list[str], dict[str, str]]


class CommandError(Exception):
    """The command ended with an error; the text says which."""


def main(arguments: list[str] | None = None) -> int:
    """Run the chosen cases; 1 where a Σ r or an objective is not what it must be."""
    chosen = options().parse_args(arguments)
    if chosen.list:
        print("\n".join(f"{case.name:18}{case.words}" for case in CASES.values()))
        return 0
    if (chosen.add or chosen.show) and chosen.json is None:
        print("--add and --show want --json FILE", file=sys.stderr)
        return 2
    unknown = [name for name in chosen.cases if name not in CASES]
    if unknown:
        print(f"no such case: {', '.join(unknown)}; known: {', '.join(CASES)}", file=sys.stderr)
        return 2
    results: dict[str, Any] = {"machine": machine(), "cases": {}, "left_out": []}
    if chosen.show or (chosen.add and chosen.json.exists()):
        results = json.loads(chosen.json.read_text(encoding="utf-8"))
    if not chosen.show:
        measure(chosen, results)
    if chosen.page:
        put_into(chosen.page, markdown(results))
    print(markdown(results) if chosen.markdown else plain(results))
    return 0 if all(one["right"] for one in results["cases"].values()) else 1


def measure(chosen: argparse.Namespace, results: dict[str, Any]) -> None:
    """Measure the chosen cases, and write them down one by one."""
    names = chosen.cases or [case.name for case in CASES.values() if case.usual]
    with tempfile.TemporaryDirectory(dir=chosen.folder) as folder:
        ceres = None if chosen.no_peers else available_ceres(Path(folder), results)
        say("mor compile")
        if (done := run([sys.executable, "-m", "mor", "compile"], Path(folder), {"PYTHONPATH": path()})).code:
            leave_out(results, f"compiled kernels: {done.errors.strip()}")
        for name in names:
            say(f"{name}: {CASES[name].words}")
            place = Path(folder) / name
            place.mkdir()
            results["cases"][name] = measured(CASES[name], place, ceres, chosen, results)
            shutil.rmtree(place)
            if chosen.json:
                chosen.json.write_text(json.dumps(results, indent=1) + "\n", encoding="utf-8")


def options() -> argparse.ArgumentParser:
    """The command line."""
    parser = argparse.ArgumentParser(description="Times mor and its peers on the same data.")
    parser.add_argument("cases", nargs="*", metavar="CASE", help="what to measure [the usual cases]")
    parser.add_argument("--list", action="store_true", help="name the cases and stop")
    parser.add_argument("--no-peers", action="store_true", help="time mor alone")
    parser.add_argument("--no-commands", action="store_true", help="leave whole commands out")
    parser.add_argument("--json", type=Path, metavar="FILE", help="write everything that was measured")
    parser.add_argument("--add", action="store_true", help="keep the other cases that are in the JSON file")
    parser.add_argument("--show", action="store_true", help="measure nothing, show the JSON file")
    parser.add_argument("--markdown", action="store_true", help="print the tables as Markdown")
    parser.add_argument("--page", type=Path, metavar="FILE", help="put the tables into this page, in place of old ones")
    parser.add_argument("--pycolmap", metavar="PYTHON", help="a Python that has pycolmap [this one]")
    parser.add_argument("--gama", metavar="PROGRAM", help="gama-local of GNU Gama [the one on the path]")
    parser.add_argument(
        "--gama-limit", type=float, default=LIMIT, metavar="SECONDS", help=f"stop it then [{LIMIT:.0f}]"
    )
    parser.add_argument("--blas", default="", metavar="FOLDER", help="libblas and liblapack for Ceres [the system's]")
    parser.add_argument("--folder", metavar="FOLDER", help="where temporary data go [the system's place]")
    return parser


def put_into(page: Path, tables: str) -> None:
    """Replace what stands between the two marks of a page."""
    text = page.read_text(encoding="utf-8")
    head, rest = text.split(_BEGIN, 1)
    tail = rest.split(_END, 1)[1]
    page.write_text(f"{head}{_BEGIN}\n\n{tables}\n\n{_END}{tail}", encoding="utf-8")


def say(words: str) -> None:
    """Progress, on standard error."""
    print(words, file=sys.stderr, flush=True)


def available_ceres(folder: Path, results: dict[str, Any]) -> Path | None:
    """The program of Ceres, if it can be had; what is left out is noted."""
    try:
        return compile_ceres(folder)
    except NotAvailableError as error:
        leave_out(results, f"Ceres: {error}")
        return None


def leave_out(results: dict[str, Any], words: str) -> None:
    """Note what is not measured, and why."""
    say(f"left out: {words}")
    if words not in results["left_out"]:
        results["left_out"].append(words)


def measured(
    case: Case, folder: Path, ceres: Path | None, chosen: argparse.Namespace, results: dict[str, Any]
) -> dict[str, Any]:
    """Everything about one case."""
    scene = folder / "scene.npz"
    task(folder, "scene", case.scene, *map(str, case.sizes), str(scene))
    one: dict[str, Any] = {
        "words": case.words,
        "kernel": json.loads(task(folder, "kernel", str(scene)).output),
    }
    failed: list[str] = []
    one["load"] = os.getloadavg()[0] if hasattr(os, "getloadavg") else None
    if case.peers and ceres is not None:
        one |= peers(case, folder, scene, ceres, chosen, results)
    if case.gama and not chosen.no_peers:
        one |= gama(case, folder, scene, chosen, results)
    if case.command and not chosen.no_commands:
        one["commands"], failed = commands(case, folder, scene)
        for words in failed:
            leave_out(results, f"{case.name}, {words}")
    one["right"] = right(one) and not failed
    return one


def task(folder: Path, *arguments: str) -> Run:
    """One of the tasks of ``task.py``, with one thread."""
    done = run([sys.executable, _TASK, *arguments], folder, {**ONE_THREAD, "PYTHONPATH": path()})
    if done.code:
        sys.exit(done.errors)
    return done


def path() -> str:
    """PYTHONPATH for child processes: this repository first."""
    return os.pathsep.join([str(_ROOT), *filter(None, [os.environ.get("PYTHONPATH")])])


def peers(
    case: Case, folder: Path, scene: Path, ceres: Path, chosen: argparse.Namespace, results: dict[str, Any]
) -> dict[str, Any]:
    """The same block by Ceres and, where covariances are wanted, by pycolmap."""
    block = folder / "block.bin"
    task(folder, "block", str(scene), str(block))
    found: dict[str, Any] = {}
    try:
        found["ceres"] = adjust_by_ceres(ceres, block, case.dense, case.covariance, chosen.blas)
        if case.pycolmap:
            found["pycolmap"] = covariance_by_pycolmap(chosen.pycolmap or sys.executable, block)
    except NotAvailableError as error:
        leave_out(results, f"{case.name}, {'pycolmap' if 'ceres' in found else 'Ceres'}: {error}")
    return found


def gama(case: Case, folder: Path, scene: Path, chosen: argparse.Namespace, results: dict[str, Any]) -> dict[str, Any]:
    """The same network by gama-local, and how far its result is from mor's."""
    network = folder / "network.gkf"
    try:
        program = available_gama(chosen.gama)
        task(folder, "gkf", str(scene), str(network))
        done = adjust_by_gama(program, network, chosen.gama_limit)
    except NotAvailableError as error:
        leave_out(results, f"gama-local: {error}")
        return {}
    if "stopped_at" in done:
        leave_out(results, f"{case.name}, gama-local: not done after {chosen.gama_limit:g} s, stopped")
        return {"gama": done}
    return {"gama": done | json.loads(task(folder, "compare", str(scene), done.pop("result")).output)}


def commands(case: Case, folder: Path, scene: Path) -> tuple[dict[str, Any], list[str]]:
    """The whole of ``mor adjust``: tables read, every table written; and what did not get to its end."""
    found: dict[str, Any] = {}
    failed: list[str] = []
    for name, kind, more, environment in variants(case, folder):
        project = folder / kind
        if not project.exists():
            task(folder, "project", str(scene), str(project), kind)
        try:
            found[name] = command(project, folder, ["--table-format", kind, *more], environment)
        except CommandError as error:
            failed.append(f"{name}: {error}")
    return found, failed


def variants(case: Case, folder: Path) -> list[Variant]:
    """Name, format of the tables, options and environment of the commands of a case."""
    plain_csv: Variant = ("csv", "csv", ["--no-html"], {})
    first: Variant = ("csv, first run", "csv", ["--no-html"], {"NUMBA_CACHE_DIR": str(folder / "cache")})
    numpy: Variant = ("csv, numpy", "csv", ["--no-html", "--kernels", "numpy"], {})
    parquet: Variant = ("parquet", "parquet", ["--no-html"], {})
    html: Variant = ("csv, html", "csv", ["--html"], {})
    chosen = [first, numpy] if case.first_run else []
    chosen += [plain_csv, parquet] if case.scene == "aerial" else [plain_csv]
    return chosen if case.scene == "aerial" and case.sizes[0] >= 100 else [*chosen, html]


def command(project: Path, folder: Path, more: list[str], environment: dict[str, str]) -> dict[str, Any]:
    """One run of the command, its threads left alone as a user has them."""
    file = str(project / "project.yaml")
    line = [sys.executable, "-m", "mor", "adjust", file, "--force", "--tables", "all", *more]
    done = run(line, folder, {**environment, "PYTHONPATH": path()})
    if done.code:
        raise CommandError(f"mor adjust ended with {done.code}: {done.errors.strip()}")
    tables = project / "project.results"
    results = json.loads((tables / "results.json").read_text(encoding="utf-8"))
    return {
        "cpu": done.seconds.cpu,
        "wall": done.seconds.wall,
        "peak_bytes": done.peak,
        "table_bytes": sum(f.stat().st_size for f in project.glob("*.*") if f.is_file()),
        "result_bytes": sum(f.stat().st_size for f in tables.iterdir()),
        "iterations": results["iterations"],
        "sigma0": results["sigma0"]["aposteriori"],
        "redundancy_check": results["redundancy_sum"] - results["redundancy"],
        "says": done.errors.strip().split("\n")[0],
    }


def right(one: dict[str, Any]) -> bool:
    """True where Σ r is the redundancy, and peers and whole commands reach the same solution."""
    kernel = one["kernel"]
    checks = [abs(kernel["redundancy_check"]) < 1e-6, kernel["outcome"] == "converged"]
    for done in one.get("commands", {}).values():
        checks += [abs(done["redundancy_check"]) < 1e-6, same(done["sigma0"], kernel["sigma0"])]
    if "ceres" in one:
        checks.append(same(one["ceres"]["objective"], kernel["objective"]))
    if "sigma0" in one.get("gama", {}):
        checks.append(abs(one["gama"]["sigma0"] - kernel["sigma0"]) <= GAMA_DIGITS * kernel["sigma0"])
    return all(checks)


def same(one: float, other: float) -> bool:
    """Equal to nine digits: the least that rounding of the tables and the ends of two iterations leave."""
    return abs(one - other) <= 1e-9 * abs(other)


def machine() -> dict[str, Any]:
    """The machine and the Python, without names."""
    model = platform.processor()
    try:
        lines = Path("/proc/cpuinfo").read_text(encoding="utf-8").split("\n")
        model = next(line.split(":")[1].strip() for line in lines if line.startswith("model name"))
        memory = os.sysconf("SC_PAGE_SIZE") * os.sysconf("SC_PHYS_PAGES")
    except (OSError, StopIteration, ValueError):
        memory = 0
    return {
        "processor": model,
        "cores": os.cpu_count(),
        "memory_bytes": memory,
        "system": f"{platform.system()} {platform.machine()}",
        "python": platform.python_version(),
    }


if __name__ == "__main__":
    sys.exit(main())
