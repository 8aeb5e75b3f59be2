"""The workers of a Dask cluster: the same jobs, on other machines.

Each Dask worker hands jobs one by one to a child process, that of `Workers`, so that a crash or a hang costs one
job. Jobs and results pass through the Dask worker as bytes: only the child loads what solves.

The connection to the scheduler, with TLS if it has certificates, answers in a limited time, or is lost.
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
from collections.abc import Callable, Iterator, Mapping
from concurrent.futures import FIRST_COMPLETED, Future, wait
from contextlib import suppress
from dataclasses import dataclass, fields
from functools import partial
from importlib import metadata
from multiprocessing import current_process
from pathlib import Path
from typing import TYPE_CHECKING, Self, TypeVar

from topo_search.engine.workers import Engine, Failed, Item, Result, Results, Work, Workers, WorkersLost
from topo_search.limits import quantity
from topo_search.model import BadInput
from topo_search.supervisor import tell

if TYPE_CHECKING:
    from distributed import Client, Security

Reply = TypeVar("Reply")


@dataclass(frozen=True)
class Certificates:
    """PEM files. Whoever has a certificate of the authority is trusted, whatever host it names."""

    ca: Path
    """Certificate of the authority that both ends trust."""
    cert: Path
    """Certificate of this end, signed by it."""
    key: Path
    """Private key of this end, without a passphrase."""

    def __post_init__(self) -> None:
        """Refuse files that cannot be used.

        Raises:
            BadInput: one is missing, or is no such file, or key and certificate are not of each other.
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
            context.load_cert_chain(self.cert, self.key, password="")  # no passphrase is asked for
        except ssl.SSLError as error:
            raise BadInput(option, f"must be {what} ({error})") from None


def _security(address: str, certificates: Certificates | None) -> Security | None:
    """Return how a scheduler is connected to; None: as Dask's own configuration has it.

    Raises:
        BadInput: certificates without TLS, or TLS without certificates.
    """
    encrypted = address.startswith("tls://")
    if certificates is not None:
        if not encrypted:
            raise BadInput("dask", f"must be tls://HOST:PORT for certificates, but got {address!r}")
        from distributed import Security

        ends = {"tls_ca_file": "ca", "tls_client_cert": "cert", "tls_client_key": "key"}
        files = {name: str(getattr(certificates, end)) for name, end in ends.items()}
        return Security(require_encryption=True, **files)
    if encrypted:
        import distributed  # noqa: F401 (has the defaults of the configuration)
        from dask import config

        needs = ("distributed.comm.tls.ca-file", "distributed.comm.tls.client.cert")  # a key may be in the latter
        if lacking := [name for name in needs if config.get(name) is None]:
            rule = (
                "needs certificates with tls://HOST:PORT: give --dask-ca, --dask-cert and --dask-key (in Python: "
                f"dask_tls), or set {' and '.join(lacking)} in Dask's configuration"
            )
            raise BadInput("dask", rule)
    return None


def _require_scheduler(address: str) -> None:
    """Refuse another program's port: a scheduler speaks first, and begins with the length of what it says.

    A port that is closed is left to Dask, which tries again: the scheduler may only just be starting.

    Raises:
        ValueError: something else answers, or nothing does.
    """
    scheme, end = address.split("://")
    if scheme == "tls":
        return  # the handshake of TLS refuses other programs
    host, port = end.rsplit(":", 1)
    with (
        suppress(ConnectionError),
        socket.create_connection((host.strip("[]"), int(port)), DURATIONS.answer) as stream,
    ):
        greeting = stream.recv(8, socket.MSG_WAITALL)
        if len(greeting) == 8 and int.from_bytes(greeting, "little") > 1 << 20:  # a scheduler's is far shorter
            raise ValueError("another program answers there")


def _begin(function: Callable[[], Reply]) -> Future[Reply]:
    """Call a function in a thread that is left to itself when nobody waits any more."""
    ended: Future[Reply] = Future()
    threading.Thread(target=_settle, args=(ended, function), daemon=True).start()
    return ended


def _settle(future: Future[Reply], call: Callable[[], Reply]) -> None:
    """Give a future what a call returns or raises."""
    try:
        future.set_result(call())
    except BaseException as error:  # noqa: BLE001 (whatever it is, it is raised where the result is waited for)
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
"""Distributions that a job computes with, from the task to the audit; Python counts with them."""
_first_child = threading.Lock()
_thread = threading.local()
"""Keeps, for each thread of a Dask worker, which runs one task at a time, a child that ends with the Dask worker,
and the versions that it was found to have: they must not be changed under it."""


@dataclass(frozen=True)
class Durations:
    """Durations in dealing with a Dask cluster [s]."""

    answer: float = 60.0
    """Longest wait for the scheduler to answer: it may only just be starting."""
    batch: float = 2.0
    """Target of a batch of jobs: long compared with a child's wait for the next one."""
    away: float = 600.0
    """Longest wait for Dask workers when all have left: a scheduler that was restarted may get none."""
    poll: float = 1.0
    """Period at which the scheduler's list of workers is looked at."""
    preparation: float = 600.0
    """Longest time for a Dask worker to compile before jobs are sent."""


DURATIONS = Durations()


@dataclass(frozen=True)
class Batch:
    """Jobs that are sent together."""

    calls: tuple[bytes, ...]
    """A function and its job each, pickled."""
    deadlines: tuple[float, ...]
    """Seconds that each may take."""
    seconds: float
    """After which what has not ended is dropped."""
    versions: dict[str, str]
    """Versions of the distributions that can change a result."""


@dataclass(frozen=True)
class Ended:
    """Results of a batch."""

    results: tuple[tuple[int, bytes | Failed], ...]
    """The place in the batch, and the pickled result, of each job that was begun and not dropped."""
    seconds: float
    """Time they took together [s]."""


def run_guarded(batch: Batch) -> Ended:
    """Run the jobs of a batch that can be begun in its time (in a Dask worker).

    Raises:
        WorkersLost: this Dask worker can run no job, or none whose result could be reproduced.
    """
    if getattr(_thread, "versions", None) != batch.versions:  # to look them up takes as long as many a job
        if fault := find_fault(batch.versions)():
            raise WorkersLost(f"the Dask worker {current_process().name} {fault}")
        _thread.versions = batch.versions
    if not hasattr(_thread, "child"):
        # Dask sets it for its workers, which may hold much data: the C library then gives memory back to the system
        # as soon as it is free. A solver needs it again at once, and takes a sixth longer: children do without.
        os.environ.pop("MALLOC_TRIM_THRESHOLD_", None)
        from topo_search.model.compiled_code import choose_folder

        with _first_child:
            choose_folder()  # for all children: where it is a temporary one, the line that says so comes once
        _thread.child = Workers(1).__enter__()
    child: Workers = _thread.child
    started_at = time.monotonic()

    def calls() -> Iterator[tuple[int, bytes]]:
        """Yield calls with their places. Slow jobs after quick ones may be many: who is idle shall have them."""
        for number, call in enumerate(batch.calls):
            if number == 0 or time.monotonic() - started_at < DURATIONS.batch:
                yield number, call

    results: list[tuple[int, bytes | Failed]] = []
    until = started_at + batch.seconds
    ended = child.run(_call, calls(), deadline=lambda call: batch.deadlines[call[0]], until=until)
    for (number, _), result in ended:
        if isinstance(result, WorkersLost):
            raise result
        results.append((number, result))
    return Ended(tuple(results), time.monotonic() - started_at)


def _call(call: tuple[int, bytes]) -> bytes | WorkersLost:
    """Call a function with its job (in the child); what cannot be loaded here is no fault of the job."""
    try:
        function, job = pickle.loads(call[1])
    except (AttributeError, ImportError) as error:
        return WorkersLost(f"Dask workers cannot import what they must run: {error}")
    return pickle.dumps(function(job))


def _prepare(call: tuple[Callable[[Item, Callable[[str], None]], object], Item]) -> None:
    function, task = call
    function(task, tell)


def computing_versions() -> dict[str, str]:
    """Return the versions that every Dask worker must have: those of what computes here."""
    return {"Python": platform.python_version(), **{name: metadata.version(name) for name in COMPUTING}}


def find_fault(versions: Mapping[str, str]) -> Callable[[], str | None]:
    """Return a function that says what keeps a Dask worker from being used, if anything does.

    It is sent by value and needs only Python's own library, for the worker may lack this package.

    Args:
        versions: that it must have, of the distributions that can change a result, and of Python.
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
    """The workers that a Dask scheduler has, however many join or leave; it is connected to with the first job.

    A Dask worker that ends costs nothing: its jobs are sent to another one.
    """

    def __init__(
        self,
        address: str,
        versions: Mapping[str, str],
        *,
        note: Callable[[str], None] = lambda _: None,
        certificates: Certificates | None = None,
    ) -> None:
        """Name the cluster.

        Args:
            address: the scheduler's, such as tcp://10.0.0.1:8786.
            versions: of what can change a result; every worker must have the same.
            note: receives what the user waits for.
            certificates: of an address that begins with tls://; None: as Dask's own configuration has them.

        Raises:
            BadInput: it is no address, or its certificates are missing, or of no use.
        """
        if re.fullmatch(r"(tcp|tls)://[^/\s]+:\d+", address) is None:
            rule = f"must be the address of a Dask scheduler, tcp://HOST:PORT, but got {address!r}"
            raise BadInput("dask", rule)
        self.address = address
        self._security = _security(address, certificates)
        self._client: Client | None = None
        self._versions = dict(versions)
        self._note = note
        self._looked = -math.inf
        self._left: float | None = None
        """When the last Dask worker left."""
        self._known: set[str] = set()
        self._threads = 0

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *raised: object) -> None:
        if self._client is not None:
            self._client.close(timeout=1.0)
            self._client = None

    @property
    def stands(self) -> bool:
        """True if the scheduler can be reached."""
        return self._client is not None and self._client.status == "running"

    def client(self) -> Client:
        """Return the client; the first call connects it.

        Raises:
            WorkersLost: nobody answers, or the scheduler is gone.
        """
        if self._client is None:
            self._client = self._connect()
        if not self.stands:
            raise self._loss()
        return self._client

    def _connect(self) -> Client:
        """Connect within a time limit; Dask has none for a scheduler that accepts and stays silent."""
        from distributed import Client

        def connect() -> Client:
            _require_scheduler(self.address)
            return Client(self.address, timeout=DURATIONS.answer, set_as_default=False, security=self._security)

        try:
            return _begin(connect).result(DURATIONS.answer)
        except TimeoutError as error:
            why = str(error) or f"no answer within {DURATIONS.answer:.0f} s"
        except (OSError, ValueError) as error:  # ValueError: words arrived before the handshake of TLS
            why = str(error)
        raise WorkersLost(f"no Dask scheduler answers at {self.address}: {why}")

    def threads(self) -> dict[str, int]:
        """Return how many jobs each Dask worker runs at a time."""
        return self._reply(self.client().nthreads)

    def _reply(self, ask: Callable[[], Reply]) -> Reply:
        """Return what the scheduler answers.

        Raises:
            WorkersLost: it is gone, which Dask may notice on another stream than the call's, or is silent.
        """
        answer = _begin(ask)
        until = time.monotonic() + DURATIONS.answer
        while time.monotonic() < until and self.stands and not answer.done():
            wait([answer], DURATIONS.poll)
        if not answer.done() and self.stands:
            text = f"the Dask scheduler at {self.address} has not answered for {DURATIONS.answer:.0f} s"
            raise WorkersLost(text)
        try:
            return answer.result(0)
        except OSError:  # TimeoutError among them
            raise self._loss() from None

    def _loss(self) -> WorkersLost:
        return WorkersLost(f"the Dask scheduler at {self.address} is gone")

    def _submit(self, batch: Batch, worker: str | None = None) -> Future[Ended]:
        """Hand a batch to the scheduler, for one Dask worker or whichever is free.

        Not by Dask's own executor: of a worker that ends once its result has arrived, that one makes a TypeError.
        """
        sent = self.client().submit(run_guarded, batch, workers=worker, pure=False)
        future: Future[Ended] = Future()

        def settle(_: object) -> None:
            if sent.cancelled():
                future.cancel()
            if future.set_running_or_notify_cancel():
                _settle(future, sent.result)

        sent.add_done_callback(settle)
        future.add_done_callback(lambda done: sent.cancel() if done.cancelled() else None)
        return future

    def prepare(self, function: Callable[[Item, Callable[[str], None]], object], task: Item) -> None:
        """Compile on every Dask worker there is, before a time limit counts; messages go to its log.

        One that joins later, or takes over ten minutes, compiles with its first job.
        """
        self._look()
        if self._known:
            self._note(f"preparing {quantity(len(self._known), 'Dask worker')}")
        batch = Batch(
            (pickle.dumps((_prepare, (function, task))),),
            (DURATIONS.preparation,),
            DURATIONS.preparation,
            self._versions,
        )
        running = {self._submit(batch, address) for address in self._known}
        while running:
            ended, running = wait(running, DURATIONS.poll, FIRST_COMPLETED)
            for future in ended:
                self._result(future)
            self._look()

    def do(self, work: Work[Item, Result]) -> Results[Item, Result]:
        """Yield (job, result) as batches end; about four batches a Dask thread are drawn from the jobs ahead.

        Jobs that a batch had no time to begin are sent again, before new ones are drawn. It ends when none runs and
        there are none, even if there are more once all are known.
        """
        waiting, suspects, alone = deque[Item](), deque[Item](), list[Item]()
        running: dict[Future[Ended], list[Item]] = {}
        size = 1

        def draw() -> list[Item]:
            """Take a batch; when few jobs are left, all threads shall have some of them."""
            nonlocal alone
            if alone:
                return []
            batches = 2 * max(1, self._threads)
            while len(waiting) < batches * size and (job := next(work.jobs, None)) is not None:
                waiting.append(job)
            if suspects and not waiting and not running:  # alone, each can only have ended its Dask worker itself
                alone = [suspects.popleft()]
                return alone
            return [waiting.popleft() for _ in range(min(size, math.ceil(len(waiting) / batches)))]

        batch = draw()
        try:
            while (batch or running) and time.monotonic() < work.until:
                self._look()
                while batch and len(running) < 2 * self._threads:
                    calls = tuple(pickle.dumps((work.function, job)) for job in batch)
                    limits = tuple(map(work.deadline, batch)), work.until - time.monotonic()
                    running[self._submit(Batch(calls, *limits, self._versions))] = batch
                    batch = draw()
                pause = min(DURATIONS.poll, max(0.0, work.until - time.monotonic()))
                if not running:
                    time.sleep(pause)  # for a first Dask worker
                for future in wait(running, pause, FIRST_COMPLETED).done:
                    jobs, ended = running.pop(future), self._result(future)
                    if isinstance(ended, Failed) and jobs is alone:
                        yield jobs[0], ended
                    elif isinstance(ended, Failed):
                        suspects.extend(jobs)
                    elif ended.results:
                        fitting = int(DURATIONS.batch * len(ended.results) / ended.seconds)
                        size = min(max(1, fitting), 50)  # no more: they come back together
                        numbers = {number for number, _ in ended.results}
                        waiting.extendleft(jobs[k] for k in reversed(range(len(jobs))) if k not in numbers)
                        for number, result in ended.results:
                            yield jobs[number], result if isinstance(result, Failed) else pickle.loads(result)
                    if jobs is alone:
                        alone = []
                batch = batch or draw()
        finally:
            if self.stands:
                for future in running:
                    future.cancel()

    def _look(self) -> None:
        """Find out how many jobs the Dask workers can run at a time, if that was not done just now.

        Raises:
            WorkersLost: there is no scheduler, or a Dask worker that cannot be used, or none has returned.
        """
        if time.monotonic() - self._looked < DURATIONS.poll:
            return
        first = self._looked == -math.inf
        client, threads = self.client(), self.threads()
        joined = [address for address in threads if address not in self._known]
        if joined:  # those that are just leaving are left out
            find = partial(client.run, find_fault(self._versions), workers=joined, on_error="ignore")
            for address, fault in self._reply(find).items():
                if fault is not None:
                    raise WorkersLost(f"the Dask worker {address} {fault}")
        self._known = set(threads)
        self._looked = time.monotonic()
        if threads:
            self._left = None
        elif first:
            self._note(f"the Dask scheduler at {self.address} has no workers; waiting for the first one")
        elif self._threads:
            self._left = self._looked
            patience = f"waiting {DURATIONS.away:.0f} s for one"
            self._note(f"all workers have left the Dask scheduler at {self.address}; {patience}")
        elif self._left is not None and self._looked - self._left > DURATIONS.away:
            scheduler = f"the Dask scheduler at {self.address}"
            raise WorkersLost(f"no worker has returned to {scheduler} in {DURATIONS.away:.0f} s")
        self._threads = sum(threads.values())

    def _result(self, future: Future[Ended]) -> Ended | Failed:
        """Return what came back of a batch."""
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
