"""One process that runs mutants, one after the other, each through the command line in a folder of its own."""

from __future__ import annotations

import contextlib
import io
import json
import resource
import shutil
import sys
import tempfile
import time
import warnings
from collections.abc import Iterable, Iterator, Sequence
from pathlib import Path
from typing import NamedTuple

from mor.cli import run

from .judge import Ended, faults
from .material import Material, all_material
from .mutant import Mutant, mutant

_CHECKED, _FOLLOWED = 7, 40
"""Of one in so many that were adjusted the adjusted project is read again, and all else done with the results."""


class Judged(NamedTuple):
    """A mutant that was run."""

    number: int
    material: str
    command: tuple[str, ...]
    code: int
    seconds: float
    peak: float
    faults: list[str]


def judged(made: Mutant, folder: Path) -> Judged:
    """Run a mutant in a folder that does not exist yet."""
    folder.mkdir(parents=True)
    for name, content in made.files.items():
        (folder / name).write_bytes(content)
    results, project = folder / "results", folder / made.main
    main = _ended(made.command, project, results)
    found = faults(main, folder, results)
    if main.code in (0, 1) and (results / "adjusted.yaml").is_file():
        found += [fault for ended in _follow(made.number, results) for fault in ended]
    return Judged(made.number, made.material, made.command, main.code, main.seconds, main.peak, found)


def _follow(number: int, results: Path) -> Iterator[list[str]]:
    """What is done with results afterwards."""
    if number % _CHECKED == 0:
        again = _ended(("check",), results / "adjusted.yaml", results / "none")
        yield [] if again.code == 0 else [f"adjusted.yaml: {again.said.strip().splitlines()[0]}"]
    if number % _FOLLOWED == 0:
        for k, command in enumerate((("covariance", "--blocks"), ("datum", "--to", "free"), ("plot", "network"))):
            target = results.parent / f"after{k}{'.svg' if k == 2 else '.csv' if k == 0 else ''}"
            yield faults(_ended(command, results, target), results.parent, target)


def _ended(command: tuple[str, ...], source: Path, target: Path) -> Ended:
    """Run a command in this process."""
    output = {"convert": target.with_suffix(".yaml"), "check": None}.get(command[0], target)
    arguments = [*command, str(source), *(["-o", str(output)] if output else [])]
    out, err = io.StringIO(), io.StringIO()
    _forget_peak()
    began = time.process_time()
    with contextlib.redirect_stdout(out), contextlib.redirect_stderr(err):
        code = run(arguments)
    return Ended(command, code, err.getvalue(), time.process_time() - began, _peak())


def _forget_peak() -> None:
    """Let the kernel count the peak of this process anew, where it can."""
    with contextlib.suppress(OSError):
        Path("/proc/self/clear_refs").write_text("5")


def _peak() -> float:
    """Largest memory of this process since then, GB; 0 where the system does not say."""
    with contextlib.suppress(OSError):
        for line in Path("/proc/self/status").read_text().splitlines():
            if line.startswith("VmHWM:"):
                return int(line.split()[1]) / 1e6
    return 0.0


def run_all(materials: Sequence[Material], seed: int, numbers: Iterable[int], keep: Path | None) -> Iterator[Judged]:
    """Run the mutants of these numbers; with ``keep`` those with faults stay there."""
    with tempfile.TemporaryDirectory(prefix="mutants") as temporary:
        for number in numbers:
            folder = Path(temporary) / str(number)
            result = judged(mutant(materials, seed, number), folder)
            if keep is not None and result.faults:
                shutil.copytree(folder, keep / str(number), dirs_exist_ok=True)
            shutil.rmtree(folder)
            yield result


def main() -> None:
    """Read numbers of mutants from standard input, answer each with a line of JSON."""
    seed, keep = int(sys.argv[1]), Path(sys.argv[2]) if len(sys.argv) > 2 else None
    answers = sys.stdout
    warnings.simplefilter("always")
    materials = all_material()
    size = (
        int(Path("/proc/self/statm").read_text().split()[0]) * resource.getpagesize() if sys.platform == "linux" else 0
    )
    if size:
        resource.setrlimit(resource.RLIMIT_AS, (size + 4 * 2**30,) * 2)
    for result in run_all(materials, seed, (int(line) for line in sys.stdin), keep):
        print(json.dumps(result._asdict()), file=answers, flush=True)
