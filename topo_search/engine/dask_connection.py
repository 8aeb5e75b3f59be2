"""The connection to a Dask scheduler, with TLS if it has certificates: it answers in a limited time, or is lost."""

from __future__ import annotations

import re
import socket
import ssl
import threading
from collections.abc import Callable, Iterable
from concurrent.futures import Future
from contextlib import suppress
from dataclasses import dataclass, fields
from pathlib import Path
from typing import TYPE_CHECKING, Any, TypeVar

from topo_search.engine.jobs import WorkersLost
from topo_search.model import BadInput

if TYPE_CHECKING:
    from distributed import Client, Security
Reply = TypeVar("Reply")
CONNECT = 60.0
"""Time limit for the scheduler to answer: it may only just be starting [s]."""


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
        try:
            context.load_verify_locations(cafile=self.ca)
        except ssl.SSLError as error:
            rule = f"must be a certificate in PEM format, but got {self.ca} ({error})"
            raise BadInput("dask-ca", rule) from None
        try:
            context.load_cert_chain(self.cert, self.key, password="")  # no passphrase is asked for
        except ssl.SSLError as error:
            rule = f"must be a certificate and its key in PEM format, but got {self.cert}, {self.key} ({error})"
            raise BadInput("dask-cert, dask-key", rule) from None


def security_of(address: str, certificates: Certificates | None) -> Security | None:
    """Return how a scheduler is connected to; None: as Dask's own configuration has it.

    Raises:
        BadInput: certificates without TLS, or TLS without certificates.
    """
    encrypted = address.startswith("tls://")
    if certificates is None:
        if encrypted:
            _require_configuration()
        return None
    if not encrypted:
        raise BadInput("dask", f"must be tls://HOST:PORT for certificates, but got {address!r}")
    from distributed import Security

    return Security(
        require_encryption=True,
        tls_ca_file=str(certificates.ca),
        tls_client_cert=str(certificates.cert),
        tls_client_key=str(certificates.key),
    )


def _require_configuration() -> None:
    """Refuse TLS if Dask's own configuration has no certificates either; a key may be in the certificate's file."""
    import distributed  # noqa: F401 (has the defaults of the configuration)
    from dask import config

    lacking = [
        name
        for name in ("distributed.comm.tls.ca-file", "distributed.comm.tls.client.cert")
        if config.get(name) is None
    ]
    if lacking:
        rule = (
            "needs certificates with tls://HOST:PORT: give --dask-ca, --dask-cert and --dask-key (in Python: "
            f"dask_tls), or set {' and '.join(lacking)} in Dask's configuration"
        )
        raise BadInput("dask", rule)


class Connection:
    """A client of a Dask scheduler, made when it is first needed."""

    def __init__(self, address: str, certificates: Certificates | None) -> None:
        """Name the scheduler.

        Raises:
            BadInput: it is no address, or its certificates are missing, or of no use.
        """
        if re.fullmatch(r"(tcp|tls)://[^/\s]+:\d+", address) is None:
            rule = f"must be the address of a Dask scheduler, tcp://HOST:PORT, but got {address!r}"
            raise BadInput("dask", rule)
        self.address = address
        self._security = security_of(address, certificates)
        self._client: Client | None = None

    @property
    def made(self) -> bool:
        """True if the client was made."""
        return self._client is not None

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
            raise self.loss()
        return self._client

    def _connect(self) -> Client:
        """Connect. Dask's own limit is none for a scheduler that accepts the connection and then says nothing."""
        from distributed import Client

        def connect() -> Client:
            _require_scheduler(self.address)
            return Client(self.address, timeout=CONNECT, set_as_default=False, security=self._security)

        try:
            return _call_within(CONNECT, connect)
        except TimeoutError as error:
            why = str(error) or f"no answer within {CONNECT:.0f} s"
        except (OSError, ValueError) as error:  # ValueError: words arrived before the handshake of TLS
            why = str(error)
        raise WorkersLost(f"no Dask scheduler answers at {self.address}: {why}")

    def threads(self) -> dict[str, int]:
        """Return how many jobs each Dask worker runs at a time."""
        return self._reply(self.client().nthreads)

    def run(self, function: Callable[[], Reply], workers: Iterable[str]) -> dict[str, Reply]:
        """Return what a function returns in each of some Dask workers; those that are just leaving are left out."""
        client, addresses = self.client(), list(workers)
        return self._reply(lambda: client.run(function, workers=addresses, on_error="ignore")) if addresses else {}

    def submit(
        self, function: Callable[[Any], Reply], argument: Any, *, worker: str | None = None
    ) -> Future[Reply]:
        """Hand a call to the scheduler, for one Dask worker or whichever is free.

        Not by Dask's own executor: of a worker that ends once its result has arrived, that one makes a TypeError.
        """
        sent = self.client().submit(function, argument, workers=worker, pure=False)
        future: Future[Reply] = Future()

        def settle(_: object) -> None:
            if sent.cancelled():
                future.cancel()
            if future.set_running_or_notify_cancel():
                _settle(future, sent.result)

        sent.add_done_callback(settle)
        future.add_done_callback(lambda done: sent.cancel() if done.cancelled() else None)
        return future

    def close(self) -> None:
        """End the connection, if there is one."""
        if self._client is not None:
            self._client.close(timeout=1.0)
            self._client = None

    def loss(self) -> WorkersLost:
        """Return the error that says that there is no scheduler any more."""
        return WorkersLost(f"the Dask scheduler at {self.address} is gone")

    def _reply(self, ask: Callable[[], Reply]) -> Reply:
        """Return what the scheduler answers."""
        try:
            return _call_within(CONNECT, ask)
        except TimeoutError:
            text = f"the Dask scheduler at {self.address} has not answered for {CONNECT:.0f} s"
            raise WorkersLost(text) from None
        except OSError:
            raise self.loss() from None


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
    with suppress(ConnectionError), socket.create_connection((host.strip("[]"), int(port)), CONNECT) as stream:
        greeting = stream.recv(8, socket.MSG_WAITALL)
        if len(greeting) == 8 and int.from_bytes(greeting, "little") > 1 << 20:  # a scheduler's is far shorter
            raise ValueError("another program answers there")


def _call_within(seconds: float, call: Callable[[], Reply]) -> Reply:
    """Return what a call returns, which runs in a thread that is left to itself after a time.

    Raises:
        TimeoutError: the time is over.
    """
    ended: Future[Reply] = Future()
    threading.Thread(target=_settle, args=(ended, call), daemon=True).start()
    return ended.result(seconds)


def _settle(future: Future[Reply], call: Callable[[], Reply]) -> None:
    """Give a future what a call returns or raises."""
    try:
        future.set_result(call())
    except BaseException as error:  # noqa: BLE001 (whatever it is, it is raised where the result is waited for)
        future.set_exception(error)
