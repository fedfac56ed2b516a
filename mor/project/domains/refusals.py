"""What a project in domains cannot have: said before anything is divided, all at once."""

from __future__ import annotations

from mor.errors import InputError, Problem
from mor.project.file.model import Observations, Project
from mor.project.file.nodes import Document

_INSTEAD = "adjust it on one machine, without --memory and --workers"


def refuse_unsupported(project: Project, document: Document) -> None:
    """Raise :class:`InputError` with everything in a project that domains do not do."""
    found: list[tuple[str, tuple[str | int, ...]]] = []
    if project.world is not None:
        found.append(("a network on the earth", ("world",)))
    if project.motions:
        found.append(("points that move", ("motions",)))
    if project.trajectories:
        found.append(("trajectories", ("trajectories",)))
    if project.pairs:
        found.append(("stereo pairs", ("pairs",)))
    found += [
        ("a rolling shutter", ("cameras", name, "readout"))
        for name, camera in project.cameras.items()
        if camera.readout is not None
    ]
    settings = project.settings
    if settings.robust is not None:
        found.append(("a robust solution", ("settings", "robust")))
    if settings.variance_components == "iterate":
        found.append(("iterated variance components", ("settings", "variance_components")))
    if settings.undetermined == "leave_out":
        found.append(("leaving out what nothing determines", ("settings", "undetermined")))
    if project.report.relative:
        found.append(("relative precision of pairs of points", ("report", "relative")))
    if not isinstance(project.datum, str) and project.datum.minimal is not None:
        found.append(("a minimal datum", ("datum", "minimal")))
    problems = [
        Problem(f"domains do not do this: {words}; {_INSTEAD}", document.file_of(path), document.line(path))
        for words, path in found
    ]
    if not any(is_divided(entry) for entry in project.observations):
        words = "there is nothing to divide: no image coordinates that stand in a file"
        problems.append(Problem(f"{words}; {_INSTEAD}", document.file))
    files = [
        table.file
        for table in (*project.images, *project.points, *project.observations, *project.checks)
        if table.file
    ]
    problems += [
        Problem(
            f"file {name!r} stands for several tables, which cannot be divided; {_INSTEAD}", document.file
        )
        for name in dict.fromkeys(files)
        if files.count(name) > 1
    ]
    if problems:
        raise InputError(problems)


def is_divided(entry: Observations) -> bool:
    """True for image coordinates in a file, without correlations: their rows go where their points go."""
    plain = entry.covariance is None and entry.cluster is None
    return entry.type == "image" and entry.file is not None and plain
