"""Where domains keep what they know between two calls: in memory, or in files that all processes see."""

from __future__ import annotations

import pickle
import secrets
import shutil
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any, NamedTuple, Protocol

import numpy as np

from mor.observations import (
    FOLLOWER_TYPES,
    IMAGE_TYPES,
    OBSERVED_DIFFERENCES,
    OBSERVED_PARAMETERS,
    PLAIN_TYPES,
    PROJECTION_CENTRE_TYPES,
    ObservationType,
)

_TYPES = {
    "image": IMAGE_TYPES,
    "follower": FOLLOWER_TYPES,
    "plain": PLAIN_TYPES,
    "projection centre": PROJECTION_CENTRE_TYPES,
    "parameter": OBSERVED_PARAMETERS,
    "difference": OBSERVED_DIFFERENCES,
}
"""Observation types by catalogue and key: they hold equations, which files do not."""


class Store(Protocol):
    """Objects by name. What is saved again under the same name is the same object: whoever computes it anew may."""

    def save(self, name: str, thing: Any) -> None:
        """Keep an object."""

    def load(self, name: str) -> Any:
        """An object that was kept."""

    def drop(self, name: str) -> None:
        """Forget an object, if there is one."""

    def clear(self, *but: str) -> None:
        """Forget all objects but those of some kinds: what their names begin with, up to the first ``/``."""

    @property
    def base(self) -> Store:
        """The store that this one lies above, or itself."""

    def layer(self, name: str) -> Store:
        """A store above the base: what is not in it is found there, and what is saved in it leaves the base alone."""


@dataclass(frozen=True)
class MemoryStore:
    """Objects as they are, in this process."""

    things: dict[str, Any] = field(default_factory=dict)
    below: MemoryStore | None = None

    def save(self, name: str, thing: Any) -> None:
        """Keep an object."""
        self.things[name] = thing

    def load(self, name: str) -> Any:
        """An object that was kept."""
        if name not in self.things and self.below is not None:
            return self.below.load(name)
        return self.things[name]

    def drop(self, name: str) -> None:
        """Forget an object, if there is one."""
        self.things.pop(name, None)

    def clear(self, *but: str) -> None:
        """Forget all objects but those of some kinds."""
        for name in [name for name in self.things if name.partition("/")[0] not in but]:
            del self.things[name]

    @property
    def base(self) -> MemoryStore:
        """The store that this one lies above, or itself."""
        return self.below or self

    def layer(self, name: str) -> MemoryStore:
        """A store above the base."""
        return MemoryStore(below=self.base)


class _Pickler(pickle.Pickler):
    """Observation types go into a file by their names: one that comes back is the same one.

    Arrays that repeat a row go there as that row, and come back as they were: pickle would write all rows.
    """

    def reducer_override(self, thing: Any) -> Any:
        if isinstance(thing, np.ndarray) and thing.size and 0 in thing.strides:
            once = tuple(slice(None) if stride else slice(1) for stride in thing.strides)
            return np.broadcast_to, (thing[once].copy(), thing.shape)
        if not isinstance(thing, ObservationType):
            return NotImplemented
        for catalogue, types in _TYPES.items():
            for key, one in types.items():
                if one is thing:
                    return _type_of, (catalogue, key)
        return NotImplemented


def _type_of(catalogue: str, key: str) -> ObservationType:
    return _TYPES[catalogue][key]


class FileStore(NamedTuple):
    """One file for each object in a folder; a file is there as a whole or not at all."""

    folder: Path
    below: FileStore | None = None

    def save(self, name: str, thing: Any) -> None:
        """Write an object, beside its place first."""
        path = self._path(name)
        path.parent.mkdir(parents=True, exist_ok=True)
        beside = path.with_name(f".{path.name}.{secrets.token_hex(4)}")
        with beside.open("wb") as file:
            _Pickler(file, protocol=pickle.HIGHEST_PROTOCOL).dump(thing)
        beside.replace(path)

    def load(self, name: str) -> Any:
        """Read an object."""
        path = self._path(name)
        if self.below is not None and not path.is_file():
            return self.below.load(name)
        with path.open("rb") as file:
            return pickle.load(file)

    def drop(self, name: str) -> None:
        """Delete the file of an object, if there is one."""
        self._path(name).unlink(missing_ok=True)

    def clear(self, *but: str) -> None:
        """Delete the files of all objects but those of some kinds."""
        for path in self.folder.iterdir():
            if path.is_dir() and path.name not in but:
                shutil.rmtree(path, ignore_errors=True)
            elif path.is_file() and path.stem not in but:
                path.unlink(missing_ok=True)

    @property
    def base(self) -> FileStore:
        """The store that this one lies above, or itself."""
        return self.below or self

    def layer(self, name: str) -> FileStore:
        """A store above the base."""
        return FileStore(self.base.folder.with_name(f"{self.base.folder.name}-{name}"), self.base)

    def _path(self, name: str) -> Path:
        return self.folder / f"{name}.pickle"
