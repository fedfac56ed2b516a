"""Plant faults into a copy of the program, one at a time, and report which test finds each.

``python tools/planted_faults.py`` plants every fault of ``planted_faults.yaml``; ``--only WORD`` those whose file or
fault contains a word. A fault is a file, a text that occurs in it once, and what replaces it. The tests named with it
run until the first one fails, first the default ones, then the slow ones. The exit code is 1 if a fault is not found,
or no longer fits the source.
"""

from __future__ import annotations

import argparse
import os
import re
import shlex
import shutil
import subprocess
import sys
import tempfile
import time
from pathlib import Path

import yaml

ROOT = Path(__file__).resolve().parents[1]
NO_SUCH_TEST, NO_TESTS_RAN = 4, 5
"""Exit codes of pytest."""


def copied(folder: Path) -> None:
    """Copy all files that git knows or would add."""
    command = ["git", "ls-files", "-z", "--cached", "--others", "--exclude-standard"]
    names = subprocess.run(command, cwd=ROOT, capture_output=True, text=True, check=True).stdout.split("\0")
    for name in filter(None, names):
        if (ROOT / name).is_file():
            (folder / name).parent.mkdir(parents=True, exist_ok=True)
            shutil.copyfile(ROOT / name, folder / name)


def first_failure(folder: Path, tests: list[str], marker: str) -> str | None:
    """Return the first test that fails with a marker expression, or None if none does."""
    command = [sys.executable, "-m", "pytest", "-x", "-q", "-p", "no:cacheprovider", "-m", marker, *tests]
    environment = {**os.environ, "PYTHONPATH": str(folder), "PYTHONDONTWRITEBYTECODE": "1"}
    done = subprocess.run(command, cwd=folder, env=environment, capture_output=True, text=True, check=False)
    if done.returncode in (0, NO_TESTS_RAN):
        return None
    if done.returncode == NO_SUCH_TEST:
        raise SystemExit(f"these tests do not exist: {' '.join(tests)}")
    found = re.search(r"^(?:FAILED|ERROR) (\S.*?)(?: - .*)?$", done.stdout, re.M)
    return found[1] if found else f"pytest ended with {done.returncode}: {done.stdout[-300:]}"


def judged(fault: dict[str, str], folder: Path) -> tuple[str, str]:
    """Plant one fault, run its tests, and take it out again. Return who finds it (default, slow, nobody) and where."""
    path = folder / fault["file"]
    text = path.read_text(encoding="utf-8") if path.is_file() else ""
    if text.count(fault["old"]) != 1:
        return "not planted", f"the text occurs {text.count(fault['old'])} times"
    path.write_text(text.replace(fault["old"], fault["new"]), encoding="utf-8")
    try:
        for who, marker in (("default", "not slow"), ("slow", "slow")):
            found = first_failure(folder, shlex.split(fault["tests"]), marker)
            if found is not None:
                return who, found
    finally:
        path.write_text(text, encoding="utf-8")
    return "nobody", ""


def main() -> int:
    """Plant the chosen faults and print one line for each."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--only", default="", help="a word of the file or of the fault")
    parser.add_argument("numbers", type=int, nargs="*", help="numbers of faults; all if there are none")
    chosen = parser.parse_args()
    faults = yaml.safe_load(Path(__file__).with_suffix(".yaml").read_text(encoding="utf-8"))
    missed = 0
    with tempfile.TemporaryDirectory() as name:
        copied(Path(name))
        for number, fault in enumerate(faults, start=1):
            if (
                chosen.numbers and number not in chosen.numbers
            ) or chosen.only not in f"{fault['fault']} {fault['file']}":
                continue
            begun = time.monotonic()
            who, where = judged(fault, Path(name))
            missed += who not in ("default", "slow")
            print(f"{number:3} {who:8} {time.monotonic() - begun:5.0f} s  {fault['fault']}: {where}", flush=True)
    return 1 if missed else 0


if __name__ == "__main__":
    sys.exit(main())
