"""gama-local as a peer: it is given the network of the case, what it answers is read, and it is stopped in time.

It need not be installed: a program that stands for it reads the same file by mor's own reader of that format, and
answers as gama-local does.
"""

from __future__ import annotations

import json
import subprocess
import sys
from pathlib import Path
from typing import Any

import pytest

ROOT = Path(__file__).parents[2]
RUNNER = ROOT / "benchmarks" / "run.py"

pytestmark = pytest.mark.slow

STAND_IN = """#!{python}
import sys
from pathlib import Path
import numpy as np
from mor.api.pipeline import read_document, read_network, solve_network

network, options = Path(sys.argv[1]), dict(zip(sys.argv[2::2], sys.argv[3::2]))
assert options["--cov-band"] == "0"
document = read_document(network)
solved = solve_network(read_network(document, network.parent))
things = solved.network.things["point"]
places = solved.adjustment.values["point"][things.parts["position"]] @ solved.network.edge.matrix
free = solved.network.blocks["point"].free[things.parts["position"], 0]
tag = "<point> <id>%s</id> <x>%.12f</x> <y>%.12f</y> <z>%.12f</z> </point>"
rows = [tag % (name, *place) for name, place in zip(np.array(things.ids)[free], places[free])]
fixed = [tag % (name, 0, 0, 0) for name in np.array(things.ids)[~free]]
Path(options["--xml"]).write_text(
    '<?xml version="1.0"?><gama-local-adjustment xmlns="http://www.gnu.org/software/gama/gama-local-adjustment">'
    f"<standard-deviation><apriori>1</apriori><aposteriori>{{solved.quality.sigma0:.9e}}</aposteriori>"
    f"</standard-deviation><coordinates><fixed>{{' '.join(fixed)}}</fixed>"
    f"<approximate>{{' '.join(fixed)}}</approximate><adjusted>{{' '.join(rows)}}</adjusted></coordinates>"
    "</gama-local-adjustment>"
)
"""


def program(path: Path, text: str) -> Path:
    path.write_text(text, encoding="utf-8")
    path.chmod(0o755)
    return path


def measured(folder: Path, gama: Path, *more: str) -> tuple[dict[str, Any], str]:
    """The case of 25 points, and what was printed."""
    file = folder / "out.json"
    options = ["--no-commands", "--gama", gama, "--json", file, "--folder", folder, *more]
    done = subprocess.run([sys.executable, RUNNER, "grid-25", *options], capture_output=True, text=True, check=False)
    assert done.returncode == 0, done.stdout + done.stderr
    return json.loads(file.read_text(encoding="utf-8")), done.stdout


@pytest.mark.skipif(sys.platform == "win32", reason="a script is no program there")
def test_it_is_given_the_network_of_the_case(tmp_path: Path) -> None:
    stand_in = program(tmp_path / "gama-local", STAND_IN.format(python=sys.executable, root=str(ROOT)))
    results, printed = measured(tmp_path, stand_in)
    one = results["cases"]["grid-25"]
    assert one["gama"]["sigma0"] == pytest.approx(one["kernel"]["sigma0"], rel=1e-8)
    assert one["gama"]["largest_difference"] < 1e-8
    assert one["gama"]["wall"] > 0.0
    assert "Geodetic networks" in printed


@pytest.mark.skipif(sys.platform == "win32", reason="a script is no program there")
def test_it_is_stopped_at_the_limit_and_that_is_said(tmp_path: Path) -> None:
    sleeper = program(tmp_path / "gama-local", f"#!{sys.executable}\nimport time\ntime.sleep(60)\n")
    results, printed = measured(tmp_path, sleeper, "--gama-limit", "0.3")
    assert results["cases"]["grid-25"]["gama"]["stopped_at"] == 0.3
    assert "not done after 0.3 s, stopped" in printed


def test_it_is_said_where_it_is_missing(tmp_path: Path) -> None:
    results, _ = measured(tmp_path, tmp_path / "nowhere")
    assert "gama" not in results["cases"]["grid-25"]
    assert any("gama-local" in words for words in results["left_out"])
