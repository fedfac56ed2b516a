"""The tables of a run, for the terminal and for docs/benchmarks.md."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from typing import Any, NamedTuple

from targets import judged

Cases = dict[str, dict[str, Any]]


class Table(NamedTuple):
    """A title, the header, and rows of text."""

    title: str
    header: tuple[str, ...]
    rows: list[tuple[str, ...]]


def plain(results: dict[str, Any]) -> str:
    """All tables in aligned columns, and what was aimed at."""
    found = [*tables(results["cases"]), judged_figures(results["cases"])]
    return "\n".join([_machine(results["machine"]), *_notes(results), *map(_aligned, found)])


def markdown(results: dict[str, Any]) -> str:
    """All tables as Markdown."""
    texts = [_machine(results["machine"]), *_notes(results), *map(_as_markdown, tables(results["cases"]))]
    return "\n\n".join(text.strip("\n") for text in texts)


def tables(cases: Cases) -> list[Table]:
    """Those tables that have rows."""
    every = (iterations(cases), deviations(cases), agreement(cases), commands(cases), networks(cases))
    return [table for table in every if table.rows]


def iterations(cases: Cases) -> Table:
    """One iteration, CPU seconds."""
    header = (
        "Iteration, CPU seconds", "image points", "unknowns", "steps", "mor", "Ceres, analytic", "Ceres' solver",
        "ratio", "ratio to automatic derivatives", "normals, share of dgemm", "bytes per image point",
    )  # fmt: skip
    rows = []
    for name, one in cases.items():
        kernel, ceres = one["kernel"], one.get("ceres", {})
        mor = kernel["iteration_s"][0]
        rows.append(
            (
                name,
                _count(kernel["image_points"]),
                _count(kernel["unknowns"]),
                str(kernel["iterations"]),
                _seconds(mor),
                _seconds(ceres.get("iteration_cpu")),
                ceres.get("solver", "–"),
                _ratio(ceres.get("iteration_cpu"), mor),
                _ratio(ceres.get("iteration_cpu_automatic"), mor),
                _percent(kernel.get("normals_of_dgemm")),
                _count(kernel.get("bytes_per_image_point")) if kernel["image_points"] > 100_000 else "–",
            )
        )
    return Table("One iteration", header, rows)


def deviations(cases: Cases) -> Table:
    """σ of all parameters and all redundancy numbers."""
    header = (
        "σ and r, CPU seconds", "mor, σ and r", "in iterations", "mor, all statistics", "Σ r − (n − u + d)",
        "ceres::Covariance, σ", "ratio", "pycolmap, σ", "ratio",
    )  # fmt: skip
    rows = []
    for name, one in cases.items():
        kernel = one["kernel"]
        mor = kernel["sigma_and_r_s"][0]
        ceres, colmap = (
            one.get("ceres", {}).get("covariance_cpu"),
            one.get("pycolmap", {}).get("covariance_cpu"),
        )
        rows.append(
            (
                name,
                _seconds(mor),
                f"{kernel['sigma_and_r_in_iterations']:.2f}",
                _seconds(kernel["assess_s"][0]),
                f"{kernel['redundancy_check']:.1e}",
                _seconds(ceres),
                _ratio(ceres, mor),
                _seconds(colmap),
                _ratio(colmap, mor),
            )
        )
    return Table("All σ and all redundancy numbers", header, rows)


def agreement(cases: Cases) -> Table:
    """Whether Ceres solves the same problem."""
    header = (
        "Same solution?", "σ0, mor", "σ0, Ceres", "vᵀPv, relative difference", "σ of c, relative difference",
        "Ceres' steps", "its solve, CPU s", "its solve, wall s",
        "steps and CPU s with its default trust region", "linear algebra",
    )  # fmt: skip
    rows = []
    for name, one in cases.items():
        if "ceres" not in one:
            continue
        kernel, ceres = one["kernel"], one["ceres"]
        sigma0 = (ceres["objective"] / kernel["redundancy"]) ** 0.5
        rows.append(
            (
                name,
                f"{kernel['sigma0']:.12f}",
                f"{sigma0:.12f}",
                _difference(ceres["objective"], kernel["objective"]),
                _difference(ceres.get("sigma_c"), kernel.get("sigma_c")),
                str(ceres["iterations"]),
                _seconds(ceres["solve_cpu"]),
                _seconds(ceres["fastest_solve_wall"]),
                _default_radius(ceres),
                ceres["blas"],
            )
        )
    return Table("The same problem, the same solution", header, rows)


def commands(cases: Cases) -> Table:
    """Whole commands: tables in, all tables out."""
    header = (
        "Whole command", "tables", "wall s", "CPU s", "peak, GB", "bytes per image point", "steps",
        "wall of Ceres' solve alone", "wall, ratio", "Σ r − (n − u + d)",
    )  # fmt: skip
    rows = []
    for name, one in cases.items():
        solve = one.get("ceres", {}).get("fastest_solve_wall")
        points = one["kernel"]["image_points"]
        for kind, done in one.get("commands", {}).items():
            rows.append(
                (
                    name,
                    kind,
                    f"{done['wall']:.2f}",
                    f"{done['cpu']:.2f}",
                    f"{done['peak_bytes'] / 1e9:.2f}",
                    _count(done["peak_bytes"] / points) if points > 100_000 else "–",
                    str(done["iterations"]),
                    _seconds(solve),
                    _ratio(solve, done["wall"]),
                    f"{done['redundancy_check']:.1e}",
                )
            )
    return Table("Whole commands", header, rows)


def networks(cases: Cases) -> Table:
    """Geodetic networks by gama-local: whole programs, each from its own file to its own results."""
    header = (
        "Network", "mor adjust, wall s", "CPU s", "peak, GB", "gama-local, wall s", "CPU s", "peak, GB", "wall, ratio",
        "σ0, mor", "σ0, gama-local", "largest difference of coordinates",
    )  # fmt: skip
    rows = []
    for name, one in cases.items():
        if "gama" not in one:
            continue
        gama, mor = one["gama"], one.get("commands", {}).get("csv", {})
        done = "stopped_at" not in gama
        theirs = _wall_cpu_peak(gama) if done else (f"> {gama['stopped_at']:g}", "–", "–")
        ratio = ("" if done else "> ") + _ratio(gama["wall"], mor["wall"]) if mor else "–"
        sigma0 = f"{gama['sigma0']:.6f}" if done else "–"
        largest = f"{1e3 * gama['largest_difference']:.2g} mm" if done else "–"
        own = f"{one['kernel']['sigma0']:.6f}"
        rows.append((name, *_wall_cpu_peak(mor), *theirs, ratio, own, sigma0, largest))
    return Table("Geodetic networks", header, rows)


def _wall_cpu_peak(done: dict[str, Any]) -> tuple[str, str, str]:
    if not done:
        return "–", "–", "–"
    return f"{done['wall']:.2f}", f"{done['cpu']:.2f}", f"{done['peak_bytes'] / 1e9:.2f}"


def judged_figures(cases: Cases) -> Table:
    """Targets, and the values measured in this run."""
    rows = [(one.what, one.aim, one.measured, "yes" if one.reached else "no") for one in judged(cases)]
    return Table("What was aimed at", ("What", "aim", "measured", "reached"), rows)


def _default_radius(ceres: dict[str, Any]) -> str:
    if "solve_cpu_default_radius" not in ceres:
        return "–"
    return f"{ceres['iterations_default_radius']}, {_seconds(ceres['solve_cpu_default_radius'])}"


def _machine(machine: dict[str, Any]) -> str:
    memory = machine["memory_bytes"] / 2**30
    return (
        f"{machine['processor']}, {machine['cores']} cores, {memory:.0f} GiB, {machine['system']}, "
        f"Python {machine['python']}"
    )


def _notes(results: dict[str, Any]) -> Iterator[str]:
    busy = [one["load"] for one in results["cases"].values() if one.get("load") is not None]
    if busy:
        span = f"{min(busy):.1f} to {max(busy):.1f}"
        yield f"Processes that wanted a core while this ran (load average), this one included: {span}."
    gflops = [one["kernel"]["dgemm_gflops"] for one in results["cases"].values()]
    if gflops:
        yield f"dgemm on one core: {min(gflops):.0f} to {max(gflops):.0f} GFLOP/s."
    for words in results["left_out"]:
        yield f"Left out: {words}."


def _aligned(table: Table) -> str:
    lines = [table.header, *table.rows]
    widths = [max(len(line[k]) for line in lines) for k in range(len(table.header))]
    texts = ("  ".join(text.ljust(width) for text, width in zip(line, widths, strict=True)) for line in lines)
    return "\n".join(["", table.title, "", *(text.rstrip() for text in texts)])


def _as_markdown(table: Table) -> str:
    rows = [table.header, ("---",) * len(table.header), *table.rows]
    return "\n".join([f"### {table.title}", "", *("| " + " | ".join(row) + " |" for row in rows)])


def _or_dash(show: Callable[[float], str]) -> Callable[[float | None], str]:
    return lambda value: "–" if value is None else show(value)


_count = _or_dash(lambda value: f"{value:,.0f}".replace(",", " ") if value else "–")
_seconds = _or_dash(lambda value: f"{value:.4f}" if value < 0.1 else f"{value:.3f}" if value < 10 else f"{value:.1f}")
_percent = _or_dash(lambda value: f"{100 * value:.0f} %")


def _ratio(theirs: float | None, ours: float) -> str:
    return "–" if theirs is None else f"{theirs / ours:.2f}"


def _difference(one: float | None, other: float | None) -> str:
    return "–" if one is None or other is None else f"{abs(one - other) / abs(other):.0e}"
