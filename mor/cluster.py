"""The processes of a Dask cluster, on this machine or on many, and what is asked of them before they get work.

A task is done anew where the worker that had it is lost: it must leave the same where it is done twice.
"""

from __future__ import annotations

import logging
import platform
import secrets
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from importlib.metadata import version
from importlib.util import find_spec
from pathlib import Path
from typing import Any

from mor import __version__
from mor.errors import InputError
from mor.errors import Problem as Mistake
from mor.machine import available

_PATIENCE = 60.0
"""Seconds to wait for a scheduler, for its first worker, and for one to be at work."""
_ANSWER = 20.0
"""Seconds that a scheduler may take to answer who it is."""
_LOOK = 5.0
"""Seconds after which it is looked whether there still are workers."""
_BEGINNING = 20.0
"""Seconds that workers may take to begin before others are begun in their place."""
_DEATHS = 100
"""Workers a task may lose before it is taken for what kills them."""
_SAME = ("numpy", "scipy", "polars")


@dataclass
class Cluster:
    """A cluster that does tasks."""

    client: Any
    renew: Callable[[], None] = lambda: None
    """Begins workers anew where none is left; of a cluster of others it does nothing."""
    idle_since: float | None = None
    """Since when nobody has been at work, though tasks are waited for."""
    renewed: float = 0.0
    """When workers were last begun anew."""

    def submit(self, task: Callable[..., Any], *arguments: Any) -> Any:
        """Have a worker do the task."""
        return self.client.submit(task, *arguments, pure=False)

    def result(self, submitted: Any) -> Any:
        """What the task has returned, or raised; it is waited for as long as somebody is at work.

        Raises :class:`InputError` if the task kills its workers, where they are lost and no new ones come, where the
        scheduler is lost or gives them nothing to do.
        """
        from concurrent.futures import CancelledError

        from distributed.client import FutureCancelledError
        from distributed.scheduler import KilledWorker

        try:
            while True:
                try:
                    found = submitted.result(timeout=_LOOK)
                except TimeoutError:
                    self._look()
                else:
                    self.idle_since = None
                    return found
        except KilledWorker as error:
            said = str(error).splitlines()[0]
            raise InputError(
                [
                    Mistake(
                        "workers died one after the other at the same task; "
                        f"have they less memory than they were told? {said}"
                    )
                ]
            ) from None
        except (CancelledError, FutureCancelledError, OSError):
            if submitted.status == "error":  # the task's own: a full disk, say
                raise
            raise InputError([Mistake("the scheduler is lost, and with it the tasks")]) from None

    def _look(self) -> None:
        """Begin workers anew where none is left. Raises :class:`InputError` if nobody was at work for too long."""
        at_work, workers = self._at_work()
        now = time.monotonic()
        if at_work:
            self.idle_since = None
            return
        self.idle_since = self.idle_since or now
        if now - self.idle_since > _PATIENCE:
            raise InputError([Mistake(_IDLE[workers])])
        if workers == 0 and now - self.renewed > _BEGINNING:
            self.renewed = now
            self.renew()

    def _at_work(self) -> tuple[bool, int | None]:
        """Whether a worker has something to do, and how many there are; ``None`` if the scheduler does not say."""
        try:
            told = self.client.sync(self.client.scheduler.processing, workers=None, callback_timeout=_LOOK)
        except (TimeoutError, OSError):
            return False, None
        return any(told.values()), min(len(told), 1)


_IDLE = {
    0: "all workers are lost, and no new ones come",
    1: "the scheduler has tasks and workers, and gives them nothing to do",
    None: "the scheduler does not answer any more",
}
"""What is said where nobody has been at work, by whether there are workers."""


@contextmanager
def connected(
    folder: Path, address: str | None, workers: int | None = None, memory: float | None = None
) -> Iterator[Cluster]:
    """The cluster at an address, or so many workers of this machine, which end with the work.

    All of them see ``folder``, and have ``memory`` bytes each. Raises :class:`InputError` if they cannot do it:
    another version, files they do not see, too little memory.
    """
    _check_installed(address is None)
    with _client(workers, address, memory) as (client, renew):
        _check(client, folder, memory)
        yield Cluster(client, renew)


def _check_installed(begins_workers: bool) -> None:
    wanted = ("dask", "distributed", *(["cryptography"] if begins_workers else []))
    missing = [name for name in wanted if find_spec(name) is None]
    if missing:
        words = f"{' and '.join(missing)} missing: pip install 'mor-adjustment[dask]'"
        raise InputError([Mistake(f"a cluster needs Dask, {words}")])


@contextmanager
def _client(
    workers: int | None, address: str | None, memory: float | None
) -> Iterator[tuple[Any, Callable[[], None]]]:
    import dask
    from distributed import Client, LocalCluster

    _silence()
    if address is not None:
        _check_scheduler(address)
        try:
            client = Client(address, timeout=_ANSWER, set_as_default=False)  # type: ignore[no-untyped-call]
        except (OSError, ValueError):
            raise InputError([Mistake(_NO_SCHEDULER, address)]) from None
        with client:
            yield client, lambda: None
        return
    count = workers or 1
    each = memory if memory is not None else (available() or 4e9 * count) / count
    settings = {
        "distributed.scheduler.allowed-failures": _DEATHS,
        "distributed.worker.memory.target": False,
        "distributed.worker.memory.spill": False,
        "distributed.worker.memory.pause": False,
        "distributed.worker.memory.terminate": False,
        # no pages of any kind, which any user of the machine could read
        "distributed.scheduler.http.routes": [],
        "distributed.worker.http.routes": [],
    }
    with (
        dask.config.set(settings),
        _begun(LocalCluster, count, int(each)) as cluster,
        Client(cluster, set_as_default=False) as client,  # type: ignore[no-untyped-call]
    ):

        def renew() -> None:
            cluster.scale(0)
            cluster.scale(count)

        yield client, renew


_NO_SCHEDULER = (
    "no Dask scheduler answers at this address; is it the address that `dask scheduler` prints, "
    "and does it expect TLS?"
)


def _check_scheduler(address: str) -> None:
    """Raise :class:`InputError` unless a Dask scheduler answers at an address within :data:`_ANSWER` seconds.

    Other programs may answer with anything, or not at all, and a client waits for them or takes their first bytes for
    the length of a message.
    """
    import asyncio

    from distributed.core import rpc
    from distributed.security import Security

    async def identity() -> Any:
        security = Security().get_connection_args("client")  # type: ignore[no-untyped-call]
        async with rpc(  # type: ignore[no-untyped-call]
            address, timeout=_ANSWER, connection_args=security
        ) as there:
            return await there.identity(n_workers=0)

    try:
        found = asyncio.run(asyncio.wait_for(identity(), _ANSWER))
    except Exception:  # noqa: BLE001 - whatever comes of bytes that mean something else
        found = None
    kind = found.get("type") if isinstance(found, dict) else None
    if kind is None:
        raise InputError([Mistake(_NO_SCHEDULER, address)])
    if kind != "Scheduler":
        raise InputError(
            [Mistake(f"this is the address of a {kind}, expected that of the scheduler", address)]
        )


def _silence() -> None:
    """Keep what the library logs (tracebacks of lost connections) off the terminal: what matters is told in words."""
    for name in list(logging.root.manager.loggerDict):
        if name.split(".")[0] == "distributed":
            logging.getLogger(name).setLevel(logging.CRITICAL)


def _begun(local_cluster: Callable[..., Any], count: int, each: int) -> Any:
    """A cluster on this machine, begun anew where a worker is lost before it is there. Raises :class:`InputError`."""
    until = time.monotonic() + _PATIENCE
    while True:
        try:
            return local_cluster(
                n_workers=count,
                threads_per_worker=1,
                memory_limit=each,
                dashboard_address=None,
                silence_logs=50,
                # Certificates made for this run alone: nobody else on the machine can connect and have tasks run.
                security=True,
                protocol="tls://",
            )
        except RuntimeError as error:
            if time.monotonic() > until:
                reason = str(error).splitlines()[0]
                raise InputError([Mistake(f"workers of this machine do not begin: {reason}")]) from None


def _check(client: Any, folder: Path, memory: float | None) -> None:
    """Raise :class:`InputError` with all that keeps the workers from doing it."""
    try:
        client.wait_for_workers(1, timeout=_PATIENCE)
    except TimeoutError:
        raise InputError([Mistake(f"the scheduler has no workers ({_PATIENCE:.0f} s waited)")]) from None
    folder.mkdir(parents=True, exist_ok=True)
    word = secrets.token_hex(8)
    token = folder / f"seen-by-{word}"
    token.write_text(word, encoding="ascii")
    here, problems = versions(), []
    for worker, found in sorted(_asked(client, str(token)).items()):
        other = [f"{name} {found['versions'].get(name)} there, {mine} here" for name, mine in here.items()
                 if found["versions"].get(name) != mine]  # fmt: skip
        if other:
            problems.append(Mistake(f"another version: {'; '.join(other)}", worker))
        if found["word"] != word:
            words = f"does not see {folder}: it has to be on a file system that all machines have in common"
            problems.append(Mistake(words, worker))
        if memory is not None and found["memory"] is not None and found["memory"] < memory:
            words = (
                f"has {found['memory'] / 1e9:.2f} GB of memory, and --memory counts on {memory / 1e9:.2f} GB"
            )
            problems.append(Mistake(words, worker))
    token.unlink()
    if problems:
        raise InputError(problems)


def _asked(client: Any, token: str) -> dict[str, dict[str, Any]]:
    """What is there where the workers are; those that are lost meanwhile are asked once more, when they are back."""
    until = time.monotonic() + _PATIENCE
    while True:
        try:
            return dict(client.run(_what_is_there, token))
        except OSError:  # a worker was lost while it was asked
            if time.monotonic() > until:
                raise InputError([Mistake("workers are lost as soon as they are asked")]) from None
            time.sleep(0.5)
        except Exception as error:  # noqa: BLE001 - whatever a worker without mor makes of the question
            reason = str(error).splitlines()[0] if str(error) else type(error).__name__
            raise InputError([Mistake(f"workers cannot run mor; is it installed there? {reason}")]) from None


def versions() -> dict[str, str]:
    """Versions of what makes the numbers."""
    return {
        "mor": __version__,
        "Python": platform.python_version(),
        **{name: version(name) for name in _SAME},
    }


def _what_is_there(token: str) -> dict[str, Any]:
    """Versions, memory and whether a file is seen, where a worker is."""
    path = Path(token)
    try:
        word = path.read_text(encoding="ascii")
    except OSError:
        word = ""
    return {"versions": versions(), "word": word, "memory": available()}
