"""An engine that runs jobs on the workers of a Dask cluster.

Each Dask worker passes its jobs one by one to a child process of `Workers`, so that a crash or a hang costs one
job. Jobs and results pass through the Dask worker as bytes; only the child loads the solver.

The connection to the scheduler, with TLS if there are certificates, counts as lost without an answer in limited
time.
"""

from __future__ import annotations

import math
import os
import pickle
import platform
import re
import socket
import ssl
import threading
import time
from collections import deque
from collections.abc import Callable, Iterable, Iterator, Mapping
from concurrent.futures import FIRST_COMPLETED, Future, wait
from contextlib import suppress
from dataclasses import dataclass, fields
from functools import partial
from importlib import metadata
from multiprocessing import current_process
from pathlib import Path
from typing import TYPE_CHECKING, Self, TypeVar

from topo_search.engine.workers import (
    Engine,
    Failed,
    Item,
    Note,
    Preparation,
    Result,
    Results,
    Workers,
    WorkersLost,
)
from topo_search.limits import quantity
from topo_search.model import BadInput
from topo_search.supervisor import tell

if TYPE_CHECKING:
    from distributed import Client, Security

Reply = TypeVar("Reply")


@dataclass(frozen=True)
class Certificates:
    """PEM files for TLS. Any holder of a certificate of the authority is trusted, whatever host it names."""

    ca: Path
    """Certificate of the authority that both sides trust."""
    cert: Path
    """Certificate of this side, signed by the authority."""
    key: Path
    """Private key of this side, without a passphrase."""

    def __post_init__(self) -> None:
        """Check the files.

        Raises:
            BadInput: a file is missing or invalid, or the key does not belong to the certificate.
        """
        for field in fields(self):
            path = getattr(self, field.name)
            try:
                with open(path, "rb"):
                    pass
            except OSError as error:
                raise BadInput(f"dask-{field.name}", f"{path}: {error.strerror}") from None
        context = ssl.SSLContext(ssl.PROTOCOL_TLS_CLIENT)
        option, what = "dask-ca", f"a certificate in PEM format, but got {self.ca}"
        try:
            context.load_verify_locations(cafile=self.ca)
            option = "dask-cert, dask-key"
            what = f"a certificate and its key in PEM format, but got {self.cert}, {self.key}"
            context.load_cert_chain(self.cert, self.key, password="")  # else OpenSSL would prompt for a passphrase
        except ssl.SSLError as error:
            raise BadInput(option, f"must be {what} ({error})") from None


def _security(address: str, certificates: Certificates | None) -> Security | None:
    """Return the security settings of a connection; None: those of Dask's configuration.

    Raises:
        BadInput: there are certificates without TLS, or TLS without certificates.
    """
    encrypted = address.startswith("tls://")
    if certificates is not None:
        if not encrypted:
            raise BadInput("dask", f"must be tls://HOST:PORT for certificates, but got {address!r}")
        from distributed import Security

        fields_by_name = {"tls_ca_file": "ca", "tls_client_cert": "cert", "tls_client_key": "key"}
        files = {name: str(getattr(certificates, field)) for name, field in fields_by_name.items()}
        return Security(require_encryption=True, **files)
    if encrypted:
        import distributed  # noqa: F401 (has the defaults of the configuration)
        from dask import config

        required = (
            "distributed.comm.tls.ca-file",
            "distributed.comm.tls.client.cert",
        )  # the latter may have the key
        if missing := [name for name in required if config.get(name) is None]:
            rule = (
                "needs certificates with tls://HOST:PORT: give --dask-ca, --dask-cert and --dask-key (in Python: "
                f"dask_tls), or set {' and '.join(missing)} in Dask's configuration"
            )
            raise BadInput("dask", rule)
    return None


def _require_scheduler(address: str) -> None:
    """Refuse the port of another program: a scheduler speaks first, beginning with the length of its message.

    A closed port is left to Dask, which tries again, since the scheduler may still be starting.

    Raises:
        ValueError: another program answers.
        TimeoutError: nothing answers.
    """
    scheme, location = address.split("://")
    if scheme == "tls":
        return  # the TLS handshake refuses other programs
    host, port = location.rsplit(":", 1)
    with (
        suppress(ConnectionError),
        socket.create_connection((host.strip("[]"), int(port)), DURATIONS.answer) as stream,
    ):
        greeting = stream.recv(8, socket.MSG_WAITALL)
        if len(greeting) == 8 and int.from_bytes(greeting, "little") > 1 << 20:  # a scheduler's message is short
            raise ValueError("another program answers there")


def _call_in_thread(function: Callable[[], Reply]) -> Future[Reply]:
    """Call a function in a daemon thread, which is abandoned if its result takes too long."""
    future: Future[Reply] = Future()
    threading.Thread(target=_settle, args=(future, function), daemon=True).start()
    return future


def _settle(future: Future[Reply], call: Callable[[], Reply]) -> None:
    """Set a future to what a call returns or raises."""
    try:
        future.set_result(call())
    except BaseException as error:  # noqa: BLE001 (it is raised where the result is read)
        future.set_exception(error)


COMPUTING = (
    "topo-search",
    "casadi",
    "llvmlite",
    "networkx",
    "numba",
    "numpy",
    "pydantic",
    "python-fcl",
    "scipy",
    "trimesh",
)
"""Distributions that jobs compute with, from the task to the audit; the version of Python counts too."""
_first_child = threading.Lock()
_thread = threading.local()
"""State of each thread of a Dask worker, which runs one batch at a time: its `child` process, which ends with the
Dask worker, and the `versions` that were last checked."""


@dataclass(frozen=True)
class Durations:
    """Durations for a Dask cluster [s]."""

    answer: float = 60.0
    """Longest wait for an answer of the scheduler, which may still be starting."""
    batch: float = 2.0
    """Target duration of a batch: long compared with the delay between two batches."""
    away: float = 600.0
    """Longest wait for a Dask worker after all have left."""
    poll: float = 1.0
    """Period at which the scheduler's list of workers is read."""
    preparation: float = 600.0
    """Longest time for a Dask worker to compile before it gets jobs."""


DURATIONS = Durations()


@dataclass(frozen=True)
class Batch:
    """Jobs that are sent together."""

    calls: tuple[bytes, ...]
    """For each job, its function and the job, pickled."""
    deadlines: tuple[float, ...]
    """For each job, the time after which it counts as hung [s]."""
    seconds: float
    """Time after which unfinished jobs are dropped [s]."""
    versions: dict[str, str]
    """Required versions of the distributions that can change a result."""


@dataclass(frozen=True)
class BatchResult:
    """Results of a batch."""

    results: tuple[tuple[int, bytes | Failed], ...]
    """The index in the batch and the pickled result of each job that was started and not dropped."""
    seconds: float
    """Total time [s]."""


def run_batch(batch: Batch) -> BatchResult:
    """Run the jobs of a batch that can be started in its time (in a Dask worker).

    Raises:
        WorkersLost: this Dask worker cannot run jobs, or its results may differ from those of other workers.
    """
    if getattr(_thread, "versions", None) != batch.versions:  # reading them takes as long as many a job
        if fault := find_fault(batch.versions)():
            raise WorkersLost(f"the Dask worker {current_process().name} {fault}")
        _thread.versions = batch.versions
    if not hasattr(_thread, "child"):
        # Dask sets this so that the C library returns free memory to the system immediately. Solvers need the
        # memory again at once and would take a sixth longer, so children run without it.
        os.environ.pop("MALLOC_TRIM_THRESHOLD_", None)
        from topo_search.model.compiled_code import choose_cache_folder

        with _first_child:
            choose_cache_folder()  # once for all children, since it prints a line if the folder is temporary
        _thread.child = Workers(1).__enter__()
    child: Workers = _thread.child
    started_at = time.monotonic()

    def calls() -> Iterator[tuple[int, bytes]]:
        """Yield numbered calls until the batch's time is over, so that idle workers get the remaining jobs."""
        for number, call in enumerate(batch.calls):
            if number == 0 or time.monotonic() - started_at < DURATIONS.batch:
                yield number, call

    results: list[tuple[int, bytes | Failed]] = []
    until = started_at + batch.seconds
    outcomes = child.run(_call, calls(), deadline=lambda call: batch.deadlines[call[0]], until=until)
    for (number, _), result in outcomes:
        if isinstance(result, WorkersLost):
            raise result
        results.append((number, result))
    return BatchResult(tuple(results), time.monotonic() - started_at)


def _call(numbered_call: tuple[int, bytes]) -> bytes | WorkersLost:
    """Call a function with its job (in the child); a failed import is a fault of the worker, not of the job."""
    try:
        function, job = pickle.loads(numbered_call[1])
    except (AttributeError, ImportError) as error:
        return WorkersLost(f"Dask workers cannot import what they must run: {error}")
    return pickle.dumps(function(job))


def _prepare(call: tuple[Preparation[Item], Item]) -> None:
    function, task = call
    function(task, tell)


def computing_versions() -> dict[str, str]:
    """Return the versions that every Dask worker must have: those of this process."""
    return {"Python": platform.python_version(), **{name: metadata.version(name) for name in COMPUTING}}


def find_fault(versions: Mapping[str, str]) -> Callable[[], str | None]:
    """Return a function that says why a Dask worker cannot be used, or None.

    The function is sent by value and uses only the standard library, since the worker may lack this package.

    Args:
        versions: required versions of Python and of the distributions that can change a result.
    """

    def fault() -> str | None:
        import platform
        from importlib import metadata
        from multiprocessing import current_process

        if current_process().daemon:
            setting = "DASK_DISTRIBUTED__WORKER__DAEMON=False"
            return f"cannot start a child process for its jobs: set {setting} in the environment of Dask workers"
        for name, version in versions.items():
            try:
                installed = platform.python_version() if name == "Python" else metadata.version(name)
            except metadata.PackageNotFoundError:
                return f"lacks {name}: it needs version {version}, as installed here"
            if installed != version:
                return f"has {name} {installed}, where this process has {version}: results could differ"
        return None

    return fault


class DaskWorkers(Engine):
    """Runs jobs on the workers of a Dask scheduler, which may join and leave; connects with the first job.

    If a Dask worker ends, its jobs are sent to another one.
    """

    def __init__(
        self,
        address: str,
        versions: Mapping[str, str],
        *,
        note: Callable[[str], None] = lambda _: None,
        certificates: Certificates | None = None,
    ) -> None:
        """Set up the engine.

        Args:
            address: address of the scheduler, such as tcp://10.0.0.1:8786.
            versions: versions that every worker must have.
            note: receives messages while the user waits.
            certificates: certificates for an address that begins with tls://; None: those of Dask's configuration.

        Raises:
            BadInput: the address is invalid, or does not fit the certificates.
        """
        if re.fullmatch(r"(tcp|tls)://[^/\s]+:\d+", address) is None:
            rule = f"must be the address of a Dask scheduler, tcp://HOST:PORT, but got {address!r}"
            raise BadInput("dask", rule)
        self.address = address
        self._security = _security(address, certificates)
        self._client: Client | None = None
        self._versions = dict(versions)
        self._note = note
        self._polled_at = -math.inf
        self._empty_since: float | None = None
        """When the last Dask worker left."""
        self._workers: set[str] = set()
        """Addresses of the checked Dask workers."""
        self._threads = 0
        """Number of jobs that all Dask workers run at a time."""

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *raised: object) -> None:
        if self._client is not None:
            self._client.close(timeout=1.0)
            self._client = None

    @property
    def is_connected(self) -> bool:
        """True if the scheduler can be reached."""
        return self._client is not None and self._client.status == "running"

    def client(self) -> Client:
        """Return the client; the first call connects it.

        Raises:
            WorkersLost: the scheduler does not answer, or is gone.
        """
        if self._client is None:
            self._client = self._connect()
        if not self.is_connected:
            raise self._loss()
        return self._client

    def _connect(self) -> Client:
        """Connect within a time limit, which Dask lacks for a scheduler that accepts but stays silent."""
        from distributed import Client

        def connect() -> Client:
            _require_scheduler(self.address)
            return Client(self.address, timeout=DURATIONS.answer, set_as_default=False, security=self._security)

        try:
            return _call_in_thread(connect).result(DURATIONS.answer)
        except TimeoutError as error:
            cause = str(error) or f"no answer within {DURATIONS.answer:.0f} s"
        except (OSError, ValueError) as error:  # ValueError: data arrived before the TLS handshake
            cause = str(error)
        raise WorkersLost(f"no Dask scheduler answers at {self.address}: {cause}")

    def threads(self) -> dict[str, int]:
        """Return the number of jobs that each Dask worker runs at a time, by address."""
        return self._reply(self.client().nthreads)

    def _reply(self, request: Callable[[], Reply]) -> Reply:
        """Return the scheduler's answer to a request.

        Raises:
            WorkersLost: it does not answer, or is gone, which Dask may notice on another stream than the request's.
        """
        answer = _call_in_thread(request)
        until = time.monotonic() + DURATIONS.answer
        while time.monotonic() < until and self.is_connected and not answer.done():
            wait([answer], DURATIONS.poll)
        if not answer.done() and self.is_connected:
            text = f"the Dask scheduler at {self.address} has not answered for {DURATIONS.answer:.0f} s"
            raise WorkersLost(text)
        try:
            return answer.result(0)
        except OSError:  # includes TimeoutError
            raise self._loss() from None

    def _loss(self) -> WorkersLost:
        return WorkersLost(f"the Dask scheduler at {self.address} is gone")

    def _submit(self, batch: Batch, worker: str | None = None) -> Future[BatchResult]:
        """Submit a batch to the scheduler, for one Dask worker or whichever is free.

        Dask's own executor is not used: it raises a TypeError if a worker ends after its result has arrived.
        """
        dask_future = self.client().submit(run_batch, batch, workers=worker, pure=False)
        future: Future[BatchResult] = Future()

        def settle(_: object) -> None:
            if dask_future.cancelled():
                future.cancel()
            if future.set_running_or_notify_cancel():
                _settle(future, dask_future.result)

        dask_future.add_done_callback(settle)
        future.add_done_callback(lambda f: dask_future.cancel() if f.cancelled() else None)
        return future

    def prepare(self, function: Preparation[Item], task: Item, note: Note) -> None:
        """Compile on every current Dask worker, before the first job; its messages go to the worker's log.

        A worker that joins later, or takes over ten minutes, compiles with its first job.
        """
        self._poll()
        if self._workers:
            note(f"preparing {quantity(len(self._workers), 'Dask worker')}")
        batch = Batch(
            (pickle.dumps((_prepare, (function, task))),),
            (DURATIONS.preparation,),
            DURATIONS.preparation,
            self._versions,
        )
        running = {self._submit(batch, address) for address in self._workers}
        while running:
            finished, running = wait(running, DURATIONS.poll, FIRST_COMPLETED)
            for future in finished:
                self._result(future)
            self._poll()

    def run(
        self,
        function: Callable[[Item], Result],
        jobs: Iterable[Item | None],
        *,
        deadline: Callable[[Item], float],
        until: float = math.inf,
    ) -> Results[Item, Result]:
        """Yield (job, result) as batches end; about four batches per Dask thread are drawn in advance.

        Jobs that a batch had no time to start are sent again, before new ones are drawn. The generator ends when no
        job runs and none is available, even if results would make more available.
        """
        pending, waiting, suspects, isolated = iter(jobs), deque[Item](), deque[Item](), list[Item]()
        running: dict[Future[BatchResult], list[Item]] = {}
        size = 1

        def draw() -> list[Item]:
            """Return the next batch, smaller when few jobs remain, so that all threads get some."""
            nonlocal isolated
            if isolated:
                return []
            batches = 2 * max(1, self._threads)
            while len(waiting) < batches * size and (job := next(pending, None)) is not None:
                waiting.append(job)
            if suspects and not waiting and not running:  # a job on its own is to blame if its Dask worker ends
                isolated = [suspects.popleft()]
                return isolated
            return [waiting.popleft() for _ in range(min(size, math.ceil(len(waiting) / batches)))]

        batch = draw()
        try:
            while (batch or running) and time.monotonic() < until:
                self._poll()
                while batch and len(running) < 2 * self._threads:
                    calls = tuple(pickle.dumps((function, job)) for job in batch)
                    limits = tuple(map(deadline, batch)), until - time.monotonic()
                    running[self._submit(Batch(calls, *limits, self._versions))] = batch
                    batch = draw()
                pause = min(DURATIONS.poll, max(0.0, until - time.monotonic()))
                if not running:
                    time.sleep(pause)  # until a Dask worker joins
                for future in wait(running, pause, FIRST_COMPLETED).done:
                    sent, outcome = running.pop(future), self._result(future)
                    if isinstance(outcome, Failed) and sent is isolated:
                        yield sent[0], outcome
                    elif isinstance(outcome, Failed):
                        suspects.extend(sent)
                    elif outcome.results:
                        fitting = int(DURATIONS.batch * len(outcome.results) / outcome.seconds)
                        size = min(max(1, fitting), 50)  # bounded, since all results of a batch arrive together
                        numbers = {number for number, _ in outcome.results}
                        waiting.extendleft(sent[k] for k in reversed(range(len(sent))) if k not in numbers)
                        for number, result in outcome.results:
                            yield sent[number], result if isinstance(result, Failed) else pickle.loads(result)
                    if sent is isolated:
                        isolated = []
                batch = batch or draw()
        finally:
            if self.is_connected:
                for future in running:
                    future.cancel()

    def _poll(self) -> None:
        """Update the list of Dask workers, at most once per period, and check new ones.

        Raises:
            WorkersLost: the scheduler is gone, a Dask worker cannot be used, or none has returned in time.
        """
        if time.monotonic() - self._polled_at < DURATIONS.poll:
            return
        is_first = self._polled_at == -math.inf
        client, threads = self.client(), self.threads()
        joined = [address for address in threads if address not in self._workers]
        if joined:  # "ignore": they may be leaving already
            find = partial(client.run, find_fault(self._versions), workers=joined, on_error="ignore")
            for address, fault in self._reply(find).items():
                if fault is not None:
                    raise WorkersLost(f"the Dask worker {address} {fault}")
        self._workers = set(threads)
        self._polled_at = time.monotonic()
        if threads:
            self._empty_since = None
        elif is_first:
            self._note(f"the Dask scheduler at {self.address} has no workers; waiting for the first one")
        elif self._threads:
            self._empty_since = self._polled_at
            patience = f"waiting {DURATIONS.away:.0f} s for one"
            self._note(f"all workers have left the Dask scheduler at {self.address}; {patience}")
        elif self._empty_since is not None and self._polled_at - self._empty_since > DURATIONS.away:
            scheduler = f"the Dask scheduler at {self.address}"
            raise WorkersLost(f"no worker has returned to {scheduler} in {DURATIONS.away:.0f} s")
        self._threads = sum(threads.values())

    def _result(self, future: Future[BatchResult]) -> BatchResult | Failed:
        """Return the result of a batch; Failed if it ended its Dask workers."""
        from distributed import KilledWorker

        if future.cancelled():
            raise self._loss()
        error = future.exception()
        if isinstance(error, KilledWorker):
            times = error.allowed_failures + 1
            return Failed("crash", f"the Dask worker that ran it ended, {times} times in a row")
        if isinstance(error, WorkersLost):
            raise error
        if error is not None:
            fault = f"{type(error).__name__}: {error}"
            raise WorkersLost(f"the Dask cluster at {self.address} cannot take jobs ({fault})")
        return future.result()
