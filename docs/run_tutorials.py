"""Run the commands of the tutorials and compare what they print with what the pages show.

    python docs/run_tutorials.py [NAMES]            # say where page and program differ
    python docs/run_tutorials.py [NAMES] --write    # put what the program says now into the pages

Three kinds of blocks of a page mean something:

* ``console``: lines that begin with ``$`` are run, the others are what they print;
* ``diff``: ``--- file``, then the lines of that file that go (−), come (+) or stay (blank);
* ``text`` whose first line is the name of a file and a colon: an excerpt of that file.

A line "…" stands for any lines, one that ends with "…" goes on. Blanks and numbers of iterations are not
compared, and of decimal numbers not the last digit.
"""

from __future__ import annotations

import contextlib
import difflib
import io
import re
import shlex
import subprocess
import sys
import tempfile
from pathlib import Path
from typing import NamedTuple

FOLDER = Path(__file__).parent / "tutorials"
BLOCK = re.compile(r"^```(console|diff|text)\n(.*?)^```$", re.M | re.S)
DECIMAL = re.compile(r"(?<![\w.])-?\d+\.\d+(?:e[-+]?\d+)?")
COUNT = re.compile(r"\d+ iterations?")
MORE = "…"


class Mismatch(NamedTuple):
    """An excerpt that is not what the program gives."""

    what: str
    shown: list[str]
    found: list[str]


class Outcome(NamedTuple):
    """Outcome of a tutorial."""

    mismatches: list[Mismatch]
    page: str
    """The page with what the program gives now."""
    outputs: list[str]
    """All that was printed, and all files that were shown, at full length."""


def run_page(page: str, folder: Path) -> Outcome:
    """Run a page in an empty folder. Raises :class:`ValueError` where a change does not fit its file."""
    mismatches: list[Mismatch] = []
    outputs: list[str] = []

    def excerpt(what: str, shown: list[str], text: str) -> list[str]:
        found = [line.rstrip() for line in text.splitlines()]
        outputs.append(text)
        if agrees(shown, found):
            return shown
        mismatches.append(Mismatch(what, shown, found))
        return renewed(shown, found)

    def block(match: re.Match[str]) -> str:
        kind, lines = match[1], match[2].splitlines()
        if kind == "diff":
            outputs.append(match[2])
            change(folder, lines)
            return match[0]
        if kind == "text":
            if not lines[0].endswith(":"):
                return match[0]
            text = (folder / lines[0][:-1]).read_text(encoding="utf-8")
            new = [lines[0], *excerpt(lines[0], lines[1:], text)]
        else:
            new = []
            for command, shown in commands(lines):
                new += [f"$ {command}", *excerpt(command, shown, run_command(command, folder))]
        return "\n".join([f"```{kind}", *new, "```"])

    return Outcome(mismatches, BLOCK.sub(block, page), outputs)


def commands(lines: list[str]) -> list[tuple[str, list[str]]]:
    """Commands of a console block with the lines shown below each."""
    found: list[tuple[str, list[str]]] = []
    for line in lines:
        if line.startswith("$ "):
            found.append((line[2:], []))
        else:
            found[-1][1].append(line)
    return found


def run_command(command: str, folder: Path) -> str:
    """Output of a command, messages and data together; ``mor`` runs in this process."""
    if not command.startswith("mor ") or re.search(r"[|>]", command):
        done = subprocess.run(
            command, shell=True, cwd=folder, text=True, stdout=subprocess.PIPE, stderr=subprocess.STDOUT
        )
        return done.stdout
    from mor.cli import run

    printed = io.StringIO()
    with contextlib.chdir(folder), contextlib.redirect_stdout(printed), contextlib.redirect_stderr(printed):
        run(shlex.split(command)[1:])
    return printed.getvalue()


def change(folder: Path, lines: list[str]) -> None:
    """Change a file as a diff block says: every run of lines must be there exactly once."""
    path = folder / lines[0].removeprefix("--- ")
    text = path.read_text(encoding="utf-8")
    for hunk in "\n".join(lines[1:]).split("\n@@\n"):
        parts = [line or " " for line in hunk.split("\n")]
        old = "".join(f"{line[1:]}\n" for line in parts if line[0] in " -")
        new = "".join(f"{line[1:]}\n" for line in parts if line[0] in " +")
        if text.count(old) != 1:
            raise ValueError(f"{path.name} has {text.count(old)} places with\n{old}")
        text = text.replace(old, new)
    path.write_text(text, encoding="utf-8")


def agrees(shown: list[str], found: list[str]) -> bool:
    """Is what is shown an excerpt of what was found?"""
    parts: list[list[str]] = [[]]
    for line in shown:
        if line.strip() == MORE:
            parts.append([])
        else:
            parts[-1].append(line)
    if len(parts) == 1:
        return len(shown) == len(found) and _stands_at(shown, found, 0)
    first, *middle, last = parts
    place = len(first)
    if not _stands_at(first, found, 0):
        return False
    for part in middle:
        begin = next((k for k in range(place, len(found)) if _stands_at(part, found, k)), None)
        if begin is None:
            return False
        place = begin + len(part)
    end = len(found) - len(last)
    return end >= place and _stands_at(last, found, end)


def _stands_at(part: list[str], found: list[str], place: int) -> bool:
    there = found[place : place + len(part)]
    return len(there) == len(part) and all(map(_same, part, there))


def _same(shown: str, found: str) -> bool:
    """Is this the line, but for blanks and the last digits of numbers?"""
    (words, numbers), (other, values) = _words(shown.rstrip(MORE)), _words(found)
    fits = other.startswith(words) if shown.endswith(MORE) else words == other
    return fits and all(_close(*pair) for pair in zip(numbers, values, strict=False))


def _words(line: str) -> tuple[str, list[str]]:
    text = COUNT.sub("# iterations", " ".join(line.split()))
    return DECIMAL.sub("#", text), DECIMAL.findall(text)


def _close(shown: str, found: str) -> bool:
    """Equal within one unit of the last digit shown, or within 1e-6."""
    digits, _, power = shown.partition("e")
    unit = 10.0 ** (int(power or 0) - len(digits.partition(".")[2]))
    return abs(float(shown) - float(found)) <= max(1.01 * unit, 1e-6 * abs(float(found)))


def renewed(shown: list[str], found: list[str]) -> list[str]:
    """The excerpt again, every line replaced by the one it resembles most, in the order they have."""
    kept = [line for line in shown if line.strip() != MORE]
    if len(kept) == len(shown):
        return found
    score = [[0.0] * (len(found) + 1) for _ in range(len(kept) + 1)]
    for i, line in enumerate(kept, start=1):
        for j, other in enumerate(found, start=1):
            pair = score[i - 1][j - 1] + _likeness(line, other)
            score[i][j] = max(score[i - 1][j], score[i][j - 1], pair)
    chosen: dict[int, int] = {}
    i, j = len(kept), len(found)
    while i and j:
        if score[i][j] == score[i][j - 1]:
            j -= 1
        elif score[i][j] == score[i - 1][j]:
            i -= 1
        else:
            chosen[i - 1] = j - 1
            i, j = i - 1, j - 1
    result: list[str] = []
    place = -1
    for line in shown:
        if line.strip() == MORE:
            result.append(line)
            continue
        place += 1
        if place in chosen:
            result.append(_cut(found[chosen[place]], line))
    return result


def _likeness(one: str, other: str) -> float:
    a, b = (re.sub(r"\d", "0", " ".join(text.split())) for text in (one, other))
    if a[:4] != b[:4]:
        return 0.0
    return difflib.SequenceMatcher(None, a.rstrip(MORE), b[: len(a)]).ratio() + (one == other)


def _cut(line: str, shown: str) -> str:
    return line[: len(shown) - 1].rstrip() + MORE if shown.endswith(MORE) else line


def main(arguments: list[str]) -> int:
    """Run the named pages, or all; returns 1 where page and program differ."""
    names = [name for name in arguments if name != "--write"]
    pages = [FOLDER / f"{name}.md" for name in names] or sorted(FOLDER.glob("*.md"))
    different = 0
    for path in pages:
        with tempfile.TemporaryDirectory() as folder:
            outcome = run_page(path.read_text(encoding="utf-8"), Path(folder))
        for mismatch in outcome.mismatches:
            different = 1
            print(f"\n{path.name}: {mismatch.what}", file=sys.stderr)
            now = renewed(mismatch.shown, mismatch.found)
            print("\n".join(difflib.ndiff(mismatch.shown, now)), file=sys.stderr)
        if "--write" in arguments:
            path.write_text(outcome.page, encoding="utf-8")
    return 0 if "--write" in arguments else different


if __name__ == "__main__":
    raise SystemExit(main(sys.argv[1:]))
