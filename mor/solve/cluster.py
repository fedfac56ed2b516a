"""The processes of a Dask cluster, and what is asked of them before they get work.

A task is done again where the worker that had it is lost: it must leave the same where it is done twice.
"""

from __future__ import annotations

import logging
import pickle
import platform
import secrets
import time
import warnings
from collections.abc import Callable, Iterator, Sequence
from contextlib import ExitStack, contextmanager
from dataclasses import dataclass
from importlib.metadata import version
from importlib.util import find_spec
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any, BinaryIO

from mor import __version__
from mor.errors import InputError, Message

_PATIENCE = 60.0
"""Seconds to wait for a scheduler, for its first worker, and for one to be at work."""
_ANSWER = 20.0
"""Seconds that a scheduler may take to answer who it is."""
_LOOK = 5.0
"""Seconds after which it is looked whether there still are workers."""


def _scheduler_lost() -> InputError:
    return InputError([Message("the scheduler is lost, and with it the tasks")])


@dataclass
class ComputeCluster:
    """A cluster that does tasks."""

    client: Any
    folder: Path | None = None
    """Folder that the workers see as well: what is large goes through files in it, not through the scheduler."""
    idle_since: float | None = None
    """Since when nobody has been at work, though tasks are waited for."""
    kept: tuple[object, _Sent] | None = None
    """What the workers keep for several tasks, and its copies there."""

    def submit(self, task: Callable[..., Any], *arguments: Any) -> Any:
        """Have a worker do the task. Raises :class:`InputError` if the connection to the scheduler is closed."""
        if self.client.status == "closed":
            raise _scheduler_lost()
        return self.client.submit(task, *arguments, pure=False)

    def result(self, submitted: Any) -> Any:
        """Return the value of the task, or raise its error; waits as long as a worker is busy.

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
                    Message(
                        "workers died one after another at the same task; do "
                        f"they have less memory than they are configured for? {said}"
                    )
                ]
            ) from None
        except (CancelledError, FutureCancelledError, OSError):
            if submitted.status == "error":  # the task's own: a full disk, say
                raise
            raise _scheduler_lost() from None

    def results(self, shared: object, call: Callable[..., Any], each: Sequence[Any], common: object) -> Iterator[Any]:
        """Yield ``call(shared, one, common)`` for all of them, in their order.

        A worker keeps ``shared`` until there is another one; workers that join later get it, too. Raises what a task
        raises, and :class:`InputError` as :meth:`result`.
        """
        if self.kept is None or self.kept[0] is not shared:
            if self.kept is not None:
                self.kept[1].forget()  # before the next one is sent
            self.kept = shared, self._sent(shared)
        sent = self._sent(common)
        tasks = [self.submit(_done, self.folder, call, self.kept[1].there, one, sent.there) for one in each]
        for task in tasks:
            found = self.result(task)
            yield found if self.folder is None else _loaded(found, remove=True)
        sent.forget()

    def _sent(self, value: object) -> _Sent:
        import cloudpickle  # type: ignore[import-untyped]

        # The value of a task can be had again where its worker is lost, not so one that is scattered.
        if self.folder is not None:
            path = _written(self.folder, value, cloudpickle.dump)
            return _Sent(self.submit(_loaded, path), path)
        with warnings.catch_warnings():
            warnings.simplefilter("ignore", UserWarning)  # that it is large
            return _Sent(self.submit(pickle.loads, cloudpickle.dumps(value)))

    def _look(self) -> None:
        """Raise :class:`InputError` if nobody has been at work for too long."""
        at_work, workers = self._at_work()
        now = time.monotonic()
        if at_work:
            self.idle_since = None
            return
        self.idle_since = self.idle_since or now
        if now - self.idle_since > _PATIENCE:
            # Why nobody is at work, by whether there are workers.
            idle = {
                0: "all workers are lost, and no new ones have joined",
                1: "the scheduler has tasks and workers, and gives them nothing to do",
                None: "the scheduler has stopped answering",
            }
            raise InputError([Message(idle[workers])])

    def _at_work(self) -> tuple[bool, int | None]:
        """Return whether a worker is busy, and the number of workers; ``None`` if the scheduler does not answer."""
        if self.client.scheduler is None:
            return False, None
        try:
            told = self.client.sync(self.client.scheduler.processing, workers=None, callback_timeout=_LOOK)
        except (TimeoutError, OSError):
            return False, None
        return any(told.values()), min(len(told), 1)


@dataclass
class _Sent:
    """A value that workers have, and the file that they get it from."""

    there: Any
    path: Path | None = None

    def forget(self) -> None:
        self.there = None
        if self.path is not None:
            self.path.unlink()


def _written(folder: Path, value: object, dump: Callable[[object, BinaryIO], None] = pickle.dump) -> Path:
    path = folder / secrets.token_hex(16)
    with path.open("wb") as file:
        dump(value, file)
    return path


def _loaded(path: Path, remove: bool = False) -> Any:
    with path.open("rb") as file:
        value = pickle.load(file)
    if remove:
        path.unlink()
    return value


def _done(folder: Path | None, call: Callable[..., Any], *arguments: Any) -> Any:
    """Do a task where a worker is; what it found, or the file that has it."""
    found = call(*arguments)
    return found if folder is None else _written(folder, found)


@contextmanager
def local(count: int, scratch: Path | None = None) -> Iterator[ComputeCluster]:
    """A cluster of so many processes of this machine, with a folder for files of theirs in ``scratch``.

    They and this process talk by TLS with keys of their own.
    """
    _check_installed("cryptography")
    import dask
    from distributed import Client, LocalCluster
    from distributed.security import Security

    _silence()
    security = Security.temporary()  # type: ignore[no-untyped-call]
    with ExitStack() as held:
        # By default each process watches itself, which takes up to a tenth of a core.
        unobserved = {
            "distributed.worker.profile.enabled": False,
            "distributed.admin.tick.interval": "1s",
            "distributed.admin.system-monitor.interval": "10s",
        }
        held.enter_context(dask.config.set(unobserved))
        try:
            cluster = held.enter_context(
                LocalCluster(  # type: ignore[no-untyped-call]
                    n_workers=count,
                    threads_per_worker=1,
                    memory_limit=None,
                    preload=["mor.solve.normals"],
                    dashboard_address="127.0.0.1:0",
                    worker_dashboard_address="127.0.0.1:0",
                    protocol="tls",
                    security=security,
                    silence_logs=logging.CRITICAL,
                )
            )
            connection = Client(cluster, security=security, set_as_default=False)  # type: ignore[no-untyped-call]
            client = held.enter_context(connection)
        except (OSError, RuntimeError) as error:  # one was killed, no room for its folder
            reason = next(iter(str(error.__cause__ or error).splitlines()), type(error).__name__)
            raise InputError([Message(f"the workers cannot be started: {reason}")]) from None
        folder = held.enter_context(TemporaryDirectory(prefix="workers-", dir=scratch))
        yield ComputeCluster(client, Path(folder).resolve())


@contextmanager
def connected(folder: Path | None, address: str) -> Iterator[ComputeCluster]:
    """The cluster at an address, all workers of which see ``folder`` if there is one.

    Raises :class:`InputError` where they cannot do the work: another version, files they do not see.
    """
    _check_installed()
    from distributed import Client

    _silence()
    _check_scheduler(address)
    try:
        client = Client(address, timeout=_ANSWER, set_as_default=False)  # type: ignore[no-untyped-call]
    except (OSError, ValueError):
        raise _no_scheduler(address) from None
    with client:
        _check(client, folder)
        yield ComputeCluster(client)


def _check_installed(*more: str) -> None:
    missing = [name for name in ("dask", "distributed", *more) if find_spec(name) is None]
    if missing:
        words = f"{' and '.join(missing)} missing: pip install 'mor-adjustment[dask]'"
        raise InputError([Message(f"a cluster needs Dask, {words}")])


def _no_scheduler(address: str) -> InputError:
    words = (
        "no Dask scheduler answers at this address; "
        "is it the address that `dask scheduler` prints, and does it expect TLS?"
    )
    return InputError([Message(words, address)])


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
        raise _no_scheduler(address)
    if kind != "Scheduler":
        raise InputError([Message(f"this is the address of a {kind}, expected that of the scheduler", address)])


def _silence() -> None:
    """Keep what the library logs (tracebacks of lost connections) off the terminal: what matters is told in words."""
    for name in list(logging.root.manager.loggerDict):
        if name.split(".")[0] == "distributed":
            logging.getLogger(name).setLevel(logging.CRITICAL)


def _check(client: Any, folder: Path | None) -> None:
    """Raise :class:`InputError` with all that keeps the workers from doing it."""
    try:
        client.wait_for_workers(1, timeout=_PATIENCE)
    except TimeoutError:
        raise InputError([Message(f"the scheduler has no workers ({_PATIENCE:.0f} s waited)")]) from None
    word, token = secrets.token_hex(8), None
    if folder is not None:
        folder.mkdir(parents=True, exist_ok=True)
        token = folder / f"seen-by-{word}"
        token.write_text(word, encoding="ascii")
    here, problems = versions(), []
    for worker, found in sorted(_asked(client, str(token or "")).items()):
        other = [f"{name} {found['versions'].get(name)} there, {mine} here" for name, mine in here.items()
                 if found["versions"].get(name) != mine]  # fmt: skip
        if other:
            problems.append(Message(f"another version: {'; '.join(other)}", worker))
        if token is not None and found["word"] != word:
            words = f"does not see {folder}: it has to be on a file system that all machines share"
            problems.append(Message(words, worker))
    if token is not None:
        token.unlink()
    if problems:
        raise InputError(problems)


def _asked(client: Any, token: str) -> dict[str, dict[str, Any]]:
    """Return what the workers hold; results of workers that were lost are computed once more when others are there."""
    until = time.monotonic() + _PATIENCE
    while True:
        try:
            return dict(client.run(_what_is_there, token))
        except OSError:  # a worker was lost while it was asked
            if time.monotonic() > until:
                raise InputError([Message("workers are lost as soon as they get a task")]) from None
            time.sleep(0.5)
        except Exception as error:  # noqa: BLE001 - whatever a worker without mor makes of the question
            if client.status != "running":
                raise _scheduler_lost() from None
            reason = str(error).splitlines()[0] if str(error) else type(error).__name__
            raise InputError([Message(f"workers cannot run mor; is it installed there? {reason}")]) from None


def versions() -> dict[str, str]:
    """Versions of what makes the numbers."""
    return {
        "mor": __version__,
        "Python": platform.python_version(),
        **{name: version(name) for name in ("numpy", "scipy", "polars")},
    }


def _what_is_there(token: str) -> dict[str, Any]:
    """Versions and whether a file is seen, where a worker is."""
    path = Path(token)
    try:
        word = path.read_text(encoding="ascii")
    except OSError:
        word = ""
    return {"versions": versions(), "word": word}
