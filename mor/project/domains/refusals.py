"""What a project in domains cannot have: said before anything is divided, all at once."""

from __future__ import annotations

from mor.errors import InputError, Problem
from mor.project.file.model import Observations, Project
from mor.project.file.nodes import Document
from mor.project.network.reading import table_label

_INSTEAD = "adjust it on one machine, without --memory and --workers"


def with_snooping(project: Project, wanted: bool) -> Project:
    """The project with data snooping where that is wanted, whatever it says itself."""
    if not wanted:
        return project
    settings = project.settings.model_copy(update={"snooping": True})
    return project.model_copy(update={"settings": settings})


def refuse_unsupported(project: Project, document: Document) -> None:
    """Raise :class:`InputError` with everything in a project that domains do not do."""
    found: list[tuple[str, tuple[str | int, ...]]] = []
    if project.world is not None:
        found.append(("a network on the earth", ("world",)))
    if project.curvature:
        found.append(("the curvature of the earth", ("curvature",)))
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
    if settings.snooping and settings.robust is not None:
        found.append(("a robust solution and data snooping", ("settings", "robust")))
    if settings.snooping and settings.variance_components == "iterate":
        found.append(("iterated variance components and data snooping", ("settings", "variance_components")))
    if settings.variance_components == "iterate":
        found += [
            (f"iterated variance components of several tables of one name, {name!r}", (section,))
            for section, name in _names_of_several(project)
        ]
    if settings.undetermined == "leave_out":
        found.append(("leaving out what nothing determines", ("settings", "undetermined")))
    if project.report.relative:
        found.append(("relative precision of pairs of points", ("report", "relative")))
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


def _names_of_several(project: Project) -> list[tuple[str, str]]:
    """Section and name of tables that have one name: domains tell groups of observations apart by their names."""
    found = [
        (section, table_label(section, number, table))
        for section in ("observations", "points", "images", "stations", "systems")
        for number, table in enumerate(getattr(project, section))
    ]
    return [one for one in dict.fromkeys(found) if found.count(one) > 1]


def is_divided(entry: Observations) -> bool:
    """True for image coordinates in a file, without correlations: their rows go where their points go."""
    plain = entry.covariance is None and entry.cluster is None
    return entry.type == "image" and entry.file is not None and plain
