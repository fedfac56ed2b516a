"""``python -m tests.memory``: estimates of memory against the largest resident size, block by block, in processes."""

from __future__ import annotations

import json
import subprocess
import sys
import tempfile
from pathlib import Path

ROOT = Path(__file__).parents[2]
CASES = (
    ("grid", (25, 0), "csv"),
    ("grid", (50, 50), "csv"),
    ("grid", (100, 0), "csv"),
    ("grid", (100, 2000), "csv"),
    ("aerial", (5, 10), "csv"),
    ("aerial", (10, 20), "csv"),
    ("aerial", (20, 25), "csv"),
    ("aerial", (20, 25), "parquet"),
)


def project_of(case: tuple[str, tuple[int, ...], str], folder: Path) -> Path:
    """A simulated project of the benchmarks."""
    name, sizes, kind = case
    script = (
        "import sys; sys.path[:0] = sys.argv[1:3]; import folders, scenes; from pathlib import Path; "
        f"folders.write_project(scenes.{name}(*{sizes}), Path(sys.argv[3]), {kind!r})"
    )
    places = (str(ROOT), str(ROOT / "benchmarks"), str(folder))
    subprocess.run([sys.executable, "-c", script, *places], check=True)
    return folder / "project.yaml"


def measured(project: Path, *options: str) -> dict[str, float]:
    """What ``tests.memory.measure`` prints, run in a process of its own."""
    command = [sys.executable, "-m", "tests.memory.measure", str(project), *options]
    done = subprocess.run(command, cwd=ROOT, capture_output=True, text=True, check=True)
    return dict(json.loads(done.stdout.splitlines()[-1]))


def main() -> None:
    """Print a line for each case, twice: with the page and without."""
    for case in CASES:
        with tempfile.TemporaryDirectory() as folder:
            project = project_of(case, Path(folder))
            for options in ((), ("--no-html",)):
                found = measured(project, *options)
                ratio = found["estimated"] / found["measured"]
                words = f"{case[0]} {'x'.join(map(str, case[1]))} {case[2]} {' '.join(options)}"
                sizes = f"{found['estimated']:7.0f} MB estimated, {found['measured']:7.0f} measured"
                print(f"{words:32s} {sizes}: {ratio:.2f}", flush=True)


if __name__ == "__main__":
    main()
