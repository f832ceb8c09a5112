"""The attack list, against every server of this program: who is answered, and that it goes on answering."""

from __future__ import annotations

import asyncio
import http.client
import json
import socket
import threading
from collections.abc import Iterator
from contextlib import ExitStack, suppress
from dataclasses import dataclass
from pathlib import Path

import httpx
import psutil
import pytest
from starlette.requests import Request
from starlette.responses import Response
from starlette.types import Message, Receive, Scope, Send

from harness.record.composed import Composed
from harness.record.viewer import page_files
from harness.record.web_app import open_path, site
from harness.server import guard
from harness.server.local_server import MOST_CONNECTIONS
from tests import annotating
from tests.web import running

CHANGE = {"kind": "range", "subject": "ann", "at": 0, "last": 3, "target": "cup"}
EVIL_HOSTS = ("evil.example", "127.0.0.1.evil.example", "evil.example@127.0.0.1", "0.0.0.0", "192.168.1.2", "")
EVIL_ORIGINS = (
    {"Origin": "https://evil.example"},
    {"Origin": "null"},
    {"Origin": "http://127.0.0.1:1"},
    {"Sec-Fetch-Site": "cross-site"},
    {"Sec-Fetch-Site": "same-site"},
)
TRAVERSALS = ("/../../etc/passwd", "/..%2f..%2fetc%2fpasswd", "/%2e%2e/%2e%2e/etc/passwd", "//etc/passwd", "/x%00")


@dataclass(frozen=True)
class Server:
    """One of them, what it has to read, and where it takes JSON, if anywhere."""

    address: str
    reads: tuple[str, ...]
    takes: str | None

    @property
    def port(self) -> int:
        return int(httpx.URL(self.address).port or 0)

    @property
    def token(self) -> str:
        return self.address.partition("token=")[2]

    def ask(self, path: str, method: str = "GET", body: bytes | None = None, **headers: str) -> httpx.Response:
        """One request as given: no client tidies the path."""
        connection = http.client.HTTPConnection("127.0.0.1", self.port, timeout=60)
        try:
            connection.putrequest(method, path, skip_host="Host" in headers)
            for name, value in headers.items():
                connection.putheader(name.replace("_", "-"), value)
            if body is not None:
                connection.putheader("Content-Length", str(len(body)))
            connection.endheaders(body)
            answer = connection.getresponse()
            return httpx.Response(answer.status, headers=answer.getheaders(), content=answer.read())
        finally:
            connection.close()

    def known(self) -> dict[str, str]:
        return {"X_Vfoa_Token": self.token}

    def connect(self, said: str = "") -> socket.socket:
        """A connection on which so much was said."""
        connection = socket.create_connection(("127.0.0.1", self.port), timeout=60)
        connection.sendall(said.format(port=self.port, token=self.token).encode())
        return connection


@pytest.fixture(params=["labelling", "recordings"])
def server(request: pytest.FixtureRequest, tmp_path: Path) -> Iterator[Server]:
    """Each server of the program in turn."""
    if request.param == "labelling":
        annotating.make_work(tmp_path)
        with annotating.serve(clip=str(tmp_path / "datasets" / "noise.toml")) as page:
            reads = ("/", "/page/page.js", "/api/clip", "/api/state", "/api/scene/0", "/picture/left/0")
            yield Server(page.address, reads, "/api/change")
    else:
        (tmp_path / "one.rrd").write_bytes(bytes(1000))
        recordings = {"one": Composed(name="one", files=(tmp_path / "one.rrd",))}
        with running(site(recordings, page_files(), page=lambda where: "<!doctype html>")) as served:
            yield Server(served.address, ("/", "/viewer/", "/viewer/viewer.js", "/files/0/0.rrd"), None)


def _body(target: str) -> bytes:
    return json.dumps({"revision": 1, "changes": [{**CHANGE, "target": target}]}).encode()


def _answered(server: Server) -> bool:
    return server.ask(server.reads[-1], **server.known()).status_code == 200


def test_nobody_is_answered_without_the_token(server: Server) -> None:
    assert all(server.ask(path, **server.known()).status_code == 200 for path in server.reads)
    for path in (*server.reads, "/missing", "/open?recording=one"):
        for headers in ({}, {"X_Vfoa_Token": "guess"}, {"Cookie": f"vfoa_{server.port}=guess"}):
            answer = server.ask(path, **headers)
            assert (answer.status_code, "holds the token" in answer.text) == (403, True), path
    assert server.ask("/?token=guess").status_code == 403
    assert server.ask(f"{server.reads[-1]}?token={server.token}").status_code == 403


def test_the_token_leaves_the_address_at_once(server: Server) -> None:
    for path in ("/", open_path("a b&c", 3)):
        address = path + ("&" if "?" in path else "?") + f"token={server.token}"
        answer = server.ask(address)
        assert answer.status_code == 303
        assert server.token not in answer.headers["location"]
        assert httpx.URL(answer.headers["location"]).params == httpx.URL(path).params
        cookie = answer.headers["set-cookie"].lower()
        assert cookie.startswith(f"vfoa_{server.port}=")  # browsers send all cookies of a host to all of its ports
        assert "httponly" in cookie
        assert "samesite=strict" in cookie


def test_other_hosts_and_origins_are_refused_even_with_the_token(server: Server) -> None:
    for path in server.reads:
        for host in EVIL_HOSTS:
            assert server.ask(path, Host=host, **server.known()).status_code in (400, 421), host
        for headers in EVIL_ORIGINS:
            assert server.ask(path, **server.known(), **headers).status_code == 403, headers
    assert "access-control-allow-origin" not in server.ask("/", **server.known()).headers


def test_no_path_leads_out(server: Server) -> None:
    for start in ("", "/page", "/viewer", "/files/0", "/picture/left"):
        for path in TRAVERSALS:
            answer = server.ask(start + path, **server.known())
            assert answer.status_code == 404, start + path
            assert "root:" not in answer.text


def test_it_listens_on_this_machine_alone(server: Server) -> None:
    listening = [each for each in psutil.Process().net_connections() if each.status == "LISTEN"]
    assert {each.laddr.ip for each in listening if each.laddr.port == server.port} == {"127.0.0.1"}


@pytest.mark.parametrize("size", [str(guard.LARGEST_BODY + 1), "99999999999999999999"])
def test_a_body_that_says_it_is_huge_is_refused_unread(server: Server, size: str) -> None:
    head = "POST / HTTP/1.1\r\nHost: 127.0.0.1:{port}\r\nX-Vfoa-Token: {token}\r\nContent-Length: " + size + "\r\n\r\n"
    with server.connect(head) as connection:
        assert connection.recv(1000).split()[1] == b"413"
    assert _answered(server)


@pytest.mark.parametrize("length", ["Transfer-Encoding: chunked", "Content-Length: 2\r\nTransfer-Encoding: chunked"])
def test_a_body_without_its_length_is_refused_unread(server: Server, length: str) -> None:
    head = f"POST / HTTP/1.1\r\nHost: 127.0.0.1:{{port}}\r\nX-Vfoa-Token: {{token}}\r\n{length}\r\n\r\n"
    with server.connect(head) as connection:
        assert connection.recv(1000).split()[1] == b"411"
    assert _answered(server)


def test_a_body_that_is_cut_is_no_error() -> None:
    async def reads_the_body(scope: Scope, receive: Receive, send: Send) -> None:
        await Request(scope, receive, send).body()

    async def receive() -> Message:
        return {"type": "http.disconnect"}

    async def send(message: Message) -> None:
        pytest.fail(f"an answer to nobody: {message}")

    headers = [(b"host", b"127.0.0.1:1"), (b"x-vfoa-token", b"known"), (b"content-length", b"5")]
    scope = {"type": "http", "method": "POST", "path": "/", "query_string": b"", "headers": headers}
    asyncio.run(guard.Guard(reads_the_body, "known")(scope, receive, send))


def test_more_connections_than_the_limit_are_told_so(server: Server) -> None:
    with ExitStack() as stack:
        for _ in range(MOST_CONNECTIONS):
            stack.enter_context(server.connect())
        annotating.wait_for(lambda: server.ask("/", **server.known()).status_code == 503)
    annotating.wait_for(lambda: _answered(server))


def test_malformed_requests_are_refused_in_one_line(server: Server) -> None:
    deep = b"[" * 50_000 + b"]" * 50_000
    for body in (b"", b"{", b"\xff\xfe", b"null", b"[]", b'{"kind": {}}', b'{"at": 1e999}', deep[: guard.LARGEST_BODY]):
        if server.takes:
            answer = server.ask(server.takes, "POST", body, **server.known(), Content_Type="application/json")
            assert answer.status_code == 400, body[:20]
            assert len(answer.json()["error"].splitlines()) == 1
        else:
            assert server.ask("/", "POST", body, **server.known()).status_code == 405
    for line in ("GARBAGE", "GET / HTTP/9.9", "GET /" + "x" * 200_000 + " HTTP/1.1"):
        answer = b"reset 4"
        with suppress(ConnectionError), server.connect(line + "\r\n\r\n") as connection:
            answer = connection.recv(1000)
        assert answer.split()[1].startswith(b"4")
    assert _answered(server)


def test_of_two_writers_one_is_told_of_the_other(server: Server) -> None:
    if server.takes is None:
        pytest.skip("nothing is written there")
    path, bodies = server.takes, [_body(target) for target in ("cup", "book")]
    start, statuses = threading.Barrier(2), []

    def write(body: bytes) -> None:
        start.wait()
        answer = server.ask(path, "POST", body, **server.known(), Content_Type="application/json")
        statuses.append(answer.status_code)

    writers = [threading.Thread(target=write, args=(body,)) for body in bodies]
    for writer in writers:
        writer.start()
    for writer in writers:
        writer.join()
    assert sorted(statuses) == [200, 409]


def test_no_answer_waits_for_the_receipt_of_its_header() -> None:
    nagle: list[int] = []

    async def app(scope: Scope, receive: Receive, send: Send) -> None:
        (connection,) = served._server.server_state.connections
        accepted = connection.transport.get_extra_info("socket")
        nagle.append(accepted.getsockopt(socket.IPPROTO_TCP, socket.TCP_NODELAY))
        await Response("seen")(scope, receive, send)

    with running(app) as served:
        assert httpx.get(served.address, follow_redirects=True).text == "seen"
    assert nagle == [1]
