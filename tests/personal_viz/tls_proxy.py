"""A small reverse proxy with TLS, set up as docs/deploy.md says, or with one of its settings wrong."""

import asyncio
import contextlib
import datetime
import ipaddress
import ssl
import threading
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path

from cryptography import x509
from cryptography.hazmat.primitives import hashes, serialization
from cryptography.hazmat.primitives.asymmetric import ec
from cryptography.x509.oid import NameOID


def self_signed(folder: Path, *, days: int = 90) -> tuple[Path, Path]:
    """(certificate, key) for localhost as PEM files; the certificate is its own authority."""
    key = ec.generate_private_key(ec.SECP256R1())
    name = x509.Name([x509.NameAttribute(NameOID.COMMON_NAME, "localhost")])
    now = datetime.datetime.now(datetime.UTC)
    names = [x509.DNSName("localhost"), x509.IPAddress(ipaddress.ip_address("127.0.0.1"))]
    certificate = (
        x509.CertificateBuilder()
        .subject_name(name)
        .issuer_name(name)
        .public_key(key.public_key())
        .serial_number(x509.random_serial_number())
        .not_valid_before(now - datetime.timedelta(days=1))
        .not_valid_after(now + datetime.timedelta(days=days, hours=1))
        .add_extension(x509.SubjectAlternativeName(names), critical=False)
        .add_extension(x509.BasicConstraints(ca=True, path_length=None), critical=True)
        .sign(key, hashes.SHA256())
    )
    paths = (folder / "cert.pem", folder / "key.pem")
    paths[0].write_bytes(certificate.public_bytes(serialization.Encoding.PEM))
    paths[1].write_bytes(
        key.private_bytes(serialization.Encoding.PEM, serialization.PrivateFormat.PKCS8, serialization.NoEncryption())
    )
    return paths


@dataclass(frozen=True)
class Settings:
    """Settings of the proxy; the defaults are those of docs/deploy.md."""

    passes_upgrade: bool = True
    passes_host: bool = True
    passes_address: bool = True
    hides_headers: bool = False
    strips_secure: bool = False
    redirects: bool = True
    """Whether plain HTTP is answered with a redirect; otherwise it is served."""


class TlsProxy:
    """One request per connection, as nginx speaks to the server behind it; websockets stay open."""

    def __init__(self, behind: int, certificate: tuple[Path, Path], settings: Settings) -> None:
        """Starts in its own thread; `port` (TLS) and `http_port` are free ones."""
        self._behind, self._settings = behind, settings
        self._held: set[asyncio.Task[None] | None] = set()
        """Running connections. When a client has left, nothing else holds its task: the garbage collector would end it
        from any thread, and so close sockets under the event loop, whose next connection could then hear nothing."""
        self._context = ssl.SSLContext(ssl.PROTOCOL_TLS_SERVER)
        self._context.load_cert_chain(*certificate)
        self.port = self.http_port = 0
        self._loop = asyncio.new_event_loop()
        self._is_ready = threading.Event()
        self._thread = threading.Thread(target=self._loop.run_until_complete, args=(self._run(),), daemon=True)
        self._thread.start()
        assert self._is_ready.wait(20)

    def stop(self) -> None:
        """Ends the thread."""
        self._loop.call_soon_threadsafe(self._stop.set)
        self._thread.join(20)

    def set_behind(self, port: int) -> None:
        """Sets the port where the gateway listens."""
        self._behind = port

    async def _run(self) -> None:
        self._stop = asyncio.Event()
        secured = await asyncio.start_server(self._serve, "127.0.0.1", 0, ssl=self._context)
        plain = await asyncio.start_server(self._serve_plain, "127.0.0.1", 0)
        self.port, self.http_port = (server.sockets[0].getsockname()[1] for server in (secured, plain))
        self._is_ready.set()
        await self._stop.wait()
        secured.close()
        plain.close()
        others = asyncio.all_tasks() - {asyncio.current_task()}
        for task in others:
            task.cancel()
        await asyncio.gather(*others, return_exceptions=True)

    async def _serve_plain(self, reader: asyncio.StreamReader, writer: asyncio.StreamWriter) -> None:
        if not self._settings.redirects:
            await self._serve(reader, writer)
            return
        await reader.readuntil(b"\r\n\r\n")
        where = f"https://localhost:{self.port}/"
        writer.write(f"HTTP/1.1 308 Permanent Redirect\r\nLocation: {where}\r\nContent-Length: 0\r\n\r\n".encode())
        writer.close()

    async def _serve(self, reader: asyncio.StreamReader, writer: asyncio.StreamWriter) -> None:
        task = asyncio.current_task()
        self._held.add(task)
        with contextlib.suppress(OSError, asyncio.IncompleteReadError, asyncio.CancelledError):
            head = await reader.readuntil(b"\r\n\r\n")
            theirs, ours = await asyncio.open_connection("127.0.0.1", self._behind)
            try:
                ours.write(self._request(head, writer.get_extra_info("peername")[0]))
                up = asyncio.create_task(_copy(reader, ours))
                writer.write(self._response(await theirs.readuntil(b"\r\n\r\n")))
                await _copy(theirs, writer)
                up.cancel()
            finally:
                ours.close()
        writer.close()
        self._held.discard(task)

    def _request(self, head: bytes, peer: str) -> bytes:
        first, *lines = head.decode("latin-1").rstrip("\r\n").split("\r\n")
        headers = [tuple(line.split(": ", 1)) for line in lines]
        is_upgrade = any(name.lower() == "upgrade" for name, _ in headers) and self._settings.passes_upgrade
        dropped = {"connection", "x-forwarded-for"} | (set() if is_upgrade else {"upgrade"})
        dropped |= set() if self._settings.passes_host else {"host"}
        kept = [(name, value) for name, value in headers if name.lower() not in dropped]
        kept += [] if self._settings.passes_host else [("Host", f"127.0.0.1:{self._behind}")]
        kept += [("Connection", "Upgrade" if is_upgrade else "close")]
        kept += [("X-Forwarded-For", "192.0.2.44" if peer else "")] if self._settings.passes_address else []
        return "\r\n".join([first, *[f"{name}: {value}" for name, value in kept], "", ""]).encode("latin-1")

    def _response(self, head: bytes) -> bytes:
        lines = head.decode("latin-1").split("\r\n")
        if self._settings.hides_headers:
            lines = [line for line in lines if not line.lower().startswith(("content-security", "x-frame"))]
        if self._settings.strips_secure:
            lines = [line.replace("; Secure", "") for line in lines]
        return "\r\n".join(lines).encode("latin-1")


async def _copy(reader: asyncio.StreamReader, writer: asyncio.StreamWriter) -> None:
    with contextlib.suppress(OSError):
        while data := await reader.read(65536):
            writer.write(data)
            await writer.drain()


@contextmanager
def tls_proxy(folder: Path, settings: Settings | None = None, *, days: int = 90) -> Iterator[TlsProxy]:
    """A proxy until the end of the block, in front of nothing yet."""
    proxy = TlsProxy(0, self_signed(folder, days=days), settings or Settings())
    try:
        yield proxy
    finally:
        proxy.stop()
