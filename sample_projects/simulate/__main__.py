"""``python -m sample_projects.simulate [names]``: write the simulated files of the sample projects."""

from __future__ import annotations

import sys
from pathlib import Path

from sample_projects.simulate import SCENES, content, simulate


def main(names: list[str]) -> int:
    """Write the files of the named samples, or of all; returns the exit code."""
    unknown = [name for name in names if name not in SCENES]
    if unknown:
        print(f"unknown sample {', '.join(unknown)} (known: {', '.join(SCENES)})", file=sys.stderr)
        return 2
    root = Path(__file__).resolve().parent.parent
    for name in names or SCENES:
        for file, found in simulate(name).items():
            path = root / name / file
            path.parent.mkdir(parents=True, exist_ok=True)
            path.write_bytes(content(found))
        print(f"{name}: written", file=sys.stderr)
    return 0


if __name__ == "__main__":
    raise SystemExit(main(sys.argv[1:]))
