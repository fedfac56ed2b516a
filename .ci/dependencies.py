"""Print what the numerical tests need, for pip: the lowest versions that pyproject.toml allows, or the newest."""

import re
import sys
import tomllib
from pathlib import Path

NEEDED = ("numba", "pytest", "pytest-xdist", "opencv-python-headless", "matplotlib")
"""Of the further groups; pyproject.toml has the others."""


def main(which: str) -> None:
    """One requirement a line."""
    project = tomllib.loads((Path(__file__).parents[1] / "pyproject.toml").read_text())["project"]
    further = [line for group in project["optional-dependencies"].values() for line in group]
    chosen = [line for line in further if re.split("[<>=]", line)[0] in NEEDED]
    for line in dict.fromkeys([*project["dependencies"], *chosen]):
        print(re.sub(r">=([^,]+).*", r"==\1.*", line) if which == "lowest" else line)


if __name__ == "__main__":
    main(*sys.argv[1:])
