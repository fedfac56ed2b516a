"""Outputs of all commands against inputs of the same command, files of others, and places where nothing can be written.

    python -m tests.scenarios.output_trials --count 500 --seed 1

The commands, and which of their options and arguments name an output, come from the command line itself: an option that
is added is tried by itself. Each trial must be refused with exit code 2 and one line that names the path, and must
leave every byte of the scene as it was.
"""

from __future__ import annotations

import argparse
import os
import random
import shutil
import sys
import tempfile
from collections import Counter
from collections.abc import Iterator
from pathlib import Path
from typing import NamedTuple

import click

from mor.cli import COMMANDS, group
from mor.cli.options import OutputPath
from tests.scenarios.small_projects import mor, write, write_block


class Recipe(NamedTuple):
    """How a command is called, the inputs that it reads then, and the suffixes that its outputs may have."""

    arguments: tuple[str, ...]
    inputs: tuple[str, ...]
    suffix: str = ".txt"


_PROJECT = ("block/project.yaml", "block/points.csv", "block/rays.csv")
_RESULTS = ("results/adjusted.yaml", "results/reference.csv", "results/start_points.csv")
RECIPES: dict[str, tuple[Recipe, ...]] = {
    "adjust": (Recipe(("block/project.yaml",), _PROJECT, ".jsonl"),),
    "approximate": (Recipe(("block/project.yaml",), _PROJECT, ".svg"),),
    "design": (Recipe(("block/project.yaml",), _PROJECT),),
    "simulate": (
        Recipe(("block/project.yaml",), _PROJECT),
        Recipe(("block/project.yaml", "--runs", "2", "--jobs", "1"), _PROJECT),
    ),
    "batch": (Recipe(("block/project.yaml",), _PROJECT),),
    "new": (Recipe(("block/points.csv", "block/rays.csv"), _PROJECT[1:], ".yaml"),),
    "convert": (
        Recipe(("net.gkf",), ("net.gkf",), ".yaml"),
        Recipe(("block/project.yaml", "--to", "colmap"), _PROJECT, ""),
    ),
    "covariance": (Recipe(("results", "--full"), _RESULTS, ".npz"),),
    "datum": (Recipe(("results", "--to", "free"), _RESULTS),),
    "report": (
        Recipe(("results",), ("results/results.json",), ".html"),
        Recipe(("results", "--pdf"), ("results/report.txt",), ".pdf"),
    ),
    "certificate": (
        Recipe(("results", "K"), ("results/results.json",), ".html"),
        Recipe(("results", "K", "--to", "opencv"), ("results/adjusted.yaml",), ".yaml"),
    ),
    "compare": (Recipe(("results", "results", "--epochs"), _RESULTS[:2], ".html"),),
    "plot": (
        Recipe(("network", "results"), ("results/results.json",), ".svg"),
        Recipe(("histogram", "block/project.yaml"), _PROJECT, ".png"),
    ),
    "examples": (Recipe(("facade",), ()),),
    "verify": (Recipe((), ()),),
}
"""Every command that has an output; the tests ask for a recipe where one is missing."""
WAYS = ("itself", "symbolic link", "hard link", "by a linked folder", "another spelling")
HOPELESS = (
    "folder",
    "no folder above",
    "file above",
    "too long",
    "loop",
    "loop above",
    "pipe",
    "full",
    "no name",
)
"""Places where no file can be written."""


class Output(NamedTuple):
    """An option or argument that names an output."""

    command: str
    parameter: click.Parameter

    @property
    def is_folder(self) -> bool:
        """True for a folder of results, as its help calls it."""
        return getattr(self.parameter, "metavar", "") == "FOLDER"

    def __str__(self) -> str:
        return f"{self.command} {self.parameter.opts[0]}"


def outputs() -> list[Output]:
    """Every output of every command."""
    return [
        Output(name, one) for name, one in parameters() if isinstance(one.type, OutputPath)
    ]  # fmt: skip


def parameters() -> Iterator[tuple[str, click.Parameter]]:
    """Every parameter of every command, with the command."""
    context = click.Context(group)
    for name in COMMANDS:
        command = group.get_command(context, name)
        assert command is not None
        below = command.commands.values() if isinstance(command, click.Group) else [command]
        for one in below:
            yield from ((name, parameter) for parameter in one.params)


class Trial(NamedTuple):
    """One call that has to be refused."""

    output: Output
    recipe: Recipe
    target: str
    """Path of the output, from the folder of the scene on."""
    force: bool
    about: str

    def arguments(self) -> list[str]:
        """The command line."""
        given = list(self.recipe.arguments)
        force = ["--force"] if self.force and self.output.command not in ("batch", "examples") else []
        if isinstance(self.output.parameter, click.Argument):
            first = self.output.command == "new"
            given = [self.target, *given] if first else [*given, self.target]
            return [self.output.command, *given, *force]
        option = self.output.parameter.opts[-1]
        return [self.output.command, *given, option, self.target, *force]

    def __str__(self) -> str:
        return f"{self.output}, {self.about}: mor {' '.join(self.arguments())[:200]}"


class Scene:
    """A folder with projects and results, and its bytes."""

    def __init__(self, folder: Path):
        self.folder = folder
        write_block(folder / "block")
        net = "mor: 1\npoints:\n  - {columns: [id, x, y, z], rows: [[A, 0, 0, 10]], fixed: [x, y, z]}\n"
        net += "  - {columns: [id, x, y, z], rows: [[B, 0, 0, 11]], fixed: [x, y]}\nobservations:\n"
        net += "  - {type: height_difference, columns: [from, to, dz, sigma], rows: [[A, B, 1.001, 0.001]]}\n"
        write(folder / "net", net)
        with within(folder):
            for call in (
                ["convert", "net/project.yaml", "net.gkf"],
                ["adjust", "block/project.yaml", "-o", "results", "--no-html", "-q"],
            ):
                run = mor(*call)
                assert run.code == 0, run.err
        self.pristine = self.files()

    def files(self) -> dict[str, bytes]:
        """Every file and link of the scene."""
        found = {}
        for path in sorted(self.folder.rglob("*")):
            name = path.relative_to(self.folder).as_posix()
            if path.is_symlink():
                found[name] = os.readlink(path).encode()
            elif path.is_file():
                found[name] = path.read_bytes()
        return found


class within:  # noqa: N801 - used as a function
    """Stand in a folder for a moment."""

    def __init__(self, folder: Path):
        self.folder = folder

    def __enter__(self) -> None:
        self.before = Path.cwd()
        os.chdir(self.folder)

    def __exit__(self, *_: object) -> None:
        os.chdir(self.before)


def against_input(scene: Scene, output: Output, recipe: Recipe, name: str, way: str, force: bool) -> Trial:
    """An output that is an input of the same command, reached in some way."""
    file, other = scene.folder / name, scene.folder / f"link{recipe.suffix}"
    if way == "itself":
        return Trial(output, recipe, name, force, f"over {name}")
    if way == "another spelling":
        above, _, last = name.rpartition("/")
        target = f"./{above}/../{above}//{last}" if above else f"block/../{last}"
        return Trial(output, recipe, target, force, f"over {name} in {way}")
    if way == "symbolic link":
        other.symlink_to(file)
    elif way == "hard link":
        other.hardlink_to(file)
    else:
        (scene.folder / "linked").symlink_to(file.parent)
        return Trial(output, recipe, f"linked/{file.name}", force, f"over {name} {way}")
    return Trial(output, recipe, other.name, force, f"over a {way} to {name}")


def against_file(scene: Scene, output: Output, recipe: Recipe) -> Trial:
    """An output that is a file, or a folder with a file, of somebody else."""
    place = scene.folder / f"other{'' if output.is_folder else recipe.suffix}"
    if output.is_folder:
        place.mkdir()
        for name in (
            "notes.txt",
            "points.csv",
            "project.yaml",
            "results.json",
            "batch.txt",
            "montecarlo.txt",
            "verification.txt",
        ):
            (place / name).write_text("mine")
    else:
        place.write_text("mine")
    return Trial(output, recipe, place.name, output.is_folder, "over the file of somebody else")


def hopeless(scene: Scene, output: Output, recipe: Recipe, where: str, force: bool) -> Trial | None:
    """An output where nothing can be written; nothing where a folder can stand there all the same."""
    target = f"new{recipe.suffix}"
    makes_folders = output.is_folder or output.command in ("convert", "new")
    if where in ("folder", "pipe", "full") and output.is_folder:
        if where == "folder":
            return None
        os.mkfifo(scene.folder / target)
    elif where == "folder":
        (scene.folder / target).mkdir()
    elif where == "pipe":
        os.mkfifo(scene.folder / target)
    elif where == "full":
        if not Path("/dev/full").exists():
            return None
        (scene.folder / target).symlink_to("/dev/full")
    elif where == "no folder above":
        if makes_folders:
            return None
        target = f"nowhere/{target}"
    elif where == "file above":
        (scene.folder / "plain").write_text("mine")
        target = f"plain/{target}"
    elif where == "too long":
        target = f"{'n' * 300}{recipe.suffix}"
    elif where == "loop":
        (scene.folder / target).symlink_to(target)
    elif where == "loop above":
        (scene.folder / "round").symlink_to("round")
        target = f"round/{target}"
    elif where == "no name":
        target = f"a\0b{recipe.suffix}"
    return Trial(output, recipe, target, force, f"where nothing can be written: {where}")


def faults_of(scene: Scene, trial: Trial) -> list[str]:
    """Carry out a trial; what is wrong with the outcome. The scene is as before afterwards."""
    before = scene.files()
    with within(scene.folder):
        run = mor(*trial.arguments())
    faults = []
    if run.code != 2:
        faults.append(f"exit code {run.code}: {run.err[-300:]}")
    if "Traceback" in run.err or "internal error" in run.err:
        faults.append(f"it said: {run.err[-300:]}")
    last = Path(trial.target.split("\0")[0]).name[:40]
    if run.code == 2 and last not in run.err and not _is_named(trial, run.err):
        faults.append(f"the path is not named: {run.err[-300:]}")
    after = scene.files()
    faults += [f"{name} has changed" for name in before if before[name] != after.get(name)]
    faults += [f"{name} is new" for name in after if name not in before]
    reset(scene)
    return faults


def _is_named(trial: Trial, said: str) -> bool:
    """True where the input is named that is behind a link, or what is in the way above."""
    return any(name in said for name in (*trial.recipe.inputs, "plain", "round"))


def reset(scene: Scene) -> None:
    """Take away what a trial has put into the scene."""
    files = scene.files()
    for name in files:
        if name not in scene.pristine:
            (scene.folder / name).unlink()
    for path in sorted(scene.folder.rglob("*"), reverse=True):
        name = path.relative_to(scene.folder).as_posix()
        if path.is_symlink() or (path.exists() and not path.is_file() and not path.is_dir()):
            path.unlink()
        elif path.is_dir() and not any(one.startswith(f"{name}/") for one in scene.pristine):
            shutil.rmtree(path)
    for name, content in scene.pristine.items():
        if files.get(name) != content:
            (scene.folder / name).write_bytes(content)


def drawn(scene: Scene, draw: random.Random) -> Trial:
    """A trial at random."""
    while True:
        output = draw.choice(outputs())
        recipe = draw.choice(RECIPES[output.command])
        kind, force = draw.randrange(3), draw.random() < 0.7
        if kind == 0 and recipe.inputs:
            return against_input(scene, output, recipe, draw.choice(recipe.inputs), draw.choice(WAYS), force)
        if kind == 1:
            return against_file(scene, output, recipe)
        if kind == 2 and (found := hopeless(scene, output, recipe, draw.choice(HOPELESS), force)):
            return found
        reset(scene)


def main() -> None:
    """Do as many trials as asked for and say what came of them."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--count", type=int, default=100)
    parser.add_argument("--seed", type=int, default=1)
    given = parser.parse_args()
    draw, found, faulty = random.Random(given.seed), Counter[str](), 0
    with tempfile.TemporaryDirectory() as place:
        scene = Scene(Path(place))
        for number in range(given.count):
            trial = drawn(scene, draw)
            faults = faults_of(scene, trial)
            found[trial.output.command] += 1
            faulty += bool(faults)
            for fault in faults:
                print(f"trial {number}: {trial}\n    {fault}", flush=True)
    print(f"{given.count} trials, seed {given.seed}: {faulty} with faults; {dict(sorted(found.items()))}")
    sys.exit(1 if faulty else 0)


if __name__ == "__main__":
    main()
