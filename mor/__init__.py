"""mor: one least-squares adjustment for everything measured around an object.

    import mor

    result = mor.adjust("project.yaml")
    print(result)
    result.points.frame

What stands in ``__all__`` is kept stable; everything below it may move. Nothing is loaded until it is used.
"""

from __future__ import annotations

from importlib import import_module
from typing import TYPE_CHECKING, Any

__version__ = "0.1.0"

if TYPE_CHECKING:
    from mor.api.project import Project, read
    from mor.api.result import Result, Table, adjust
    from mor.api.verification import verify
    from mor.errors import InputError, MorError, NoSolutionError

_PLACES = {
    "Project": "mor.api.project",
    "adjust": "mor.api.result",
    "read": "mor.api.project",
    "Result": "mor.api.result",
    "Table": "mor.api.result",
    "InputError": "mor.errors",
    "MorError": "mor.errors",
    "NoSolutionError": "mor.errors",
    "verify": "mor.api.verification",
}

__all__ = [
    "InputError",
    "MorError",
    "NoSolutionError",
    "Project",
    "Result",
    "Table",
    "__version__",
    "adjust",
    "read",
    "verify",
]


def __getattr__(name: str) -> Any:
    if name not in _PLACES:
        raise AttributeError(f"module 'mor' has no attribute {name!r}")
    return getattr(import_module(_PLACES[name]), name)


def __dir__() -> list[str]:
    return list(__all__)
