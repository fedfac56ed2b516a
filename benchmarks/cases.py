"""The measured cases, one line each. Nothing heavy is imported here, see ``run.py``."""

from __future__ import annotations

from dataclasses import dataclass


@dataclass(frozen=True)
class Case:
    """One benchmark.

    Attributes:
        scene, sizes: generator in ``scenes.py`` and its arguments.
        kernel: time iterations and the σ and r pass on arrays, without files.
        command: time the whole of ``mor adjust`` on a project folder.
        first_run: time the command with an empty cache of compiled kernels and with NumPy alone as well.
        peers: time Ceres on the same data. dense: its dense solvers too, which are no use beyond some 1 000 images.
        covariance: time ``ceres::Covariance``, which takes days for more than some 50 images.
        pycolmap: time pycolmap's covariance.
        gama: time gama-local, which is for geodetic networks.
        usual: among the cases that run when none are named.
    """

    name: str
    words: str
    scene: str
    sizes: tuple[int, ...]
    kernel: bool = True
    command: bool = False
    first_run: bool = False
    peers: bool = False
    dense: bool = True
    covariance: bool = False
    pycolmap: bool = False
    gama: bool = False
    usual: bool = True


_ALL = (
    Case(
        "aerial-6",
        "2 strips of 3 images: does the runner run?",
        "aerial",
        (2, 3),
        command=True,
        peers=True,
        usual=False,
    ),
    Case("aerial-50", "5 strips of 10 images", "aerial", (5, 10), peers=True, covariance=True, pycolmap=True),
    Case(
        "aerial-500",
        "20 strips of 25 images",
        "aerial",
        (20, 25),
        command=True,
        first_run=True,
        peers=True,
        pycolmap=True,
    ),
    Case("aerial-2000", "40 strips of 50 images", "aerial", (40, 50), peers=True, dense=False),
    Case("aerial-10000", "100 strips of 100 images", "aerial", (100, 100), command=True, usual=False),
    Case("convergent-500", "500 images around an object, 30 rays", "convergent", (500, 20_000, 30), peers=True),
    Case("grid-25", "25 points: does the runner run?", "grid", (5, 0), command=True, gama=True, usual=False),
    Case("grid-2500-50", "2 500 points, 50 long ties at random", "grid", (50, 50), command=True, gama=True),
    Case("grid-10000-0", "10 000 points, neighbours only", "grid", (100, 0), command=True, gama=True),
    Case("grid-10000-200", "… and 200 long ties at random", "grid", (100, 200), command=True, gama=True),
    Case("grid-10000-2000", "… and 2 000 long ties at random", "grid", (100, 2000), command=True),
    Case("mixed-6", "6 images, 40 sights: does the runner run?", "mixed", (2, 3, 40), command=True, usual=False),
    Case(
        "mixed",
        "100 images, 5 000 tacheometric sights to points of theirs",
        "mixed",
        (10, 10, 5000),
        command=True,
    ),
    Case(
        "block-115",
        "115 images around an object, 67 rays",
        "convergent",
        (115, 149, 67),
        command=True,
        first_run=True,
    ),
)
CASES = {case.name: case for case in _ALL}
