"""The attack list, against every server of this program: who is answered, and that it goes on answering."""

from __future__ import annotations

import http.client
import json
import os
import socket
import subprocess
import sys
import threading
import time
from collections.abc import Iterator
from contextlib import ExitStack, suppress
from dataclasses import dataclass
from pathlib import Path
from subprocess import PIPE

import httpx
import psutil
import pytest

from harness.record.composed import Composed
from harness.record.web_app import open_path, site
from harness.record.web_viewer import page_files
from harness.server import guard
from tests import annotating
from tests.repository import REPOSITORY
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
        with running(site(recordings, page_files(), page=lambda: "<!doctype html>")) as served:
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


def test_a_chunked_body_obeys_the_same_limit(server: Server) -> None:
    head = (
        f"POST {server.takes or '/'} HTTP/1.1\r\nHost: 127.0.0.1:{{port}}\r\nX-Vfoa-Token: {{token}}\r\n"
        "Content-Type: application/json\r\nTransfer-Encoding: chunked\r\n\r\n"
    )
    with server.connect(head) as connection:
        connection.sendall(b"%x\r\n" % (guard.LARGEST_BODY + 1) + b" " * (guard.LARGEST_BODY + 1))
        assert connection.recv(1000).split()[1] == b"413"
    assert _answered(server)


def test_a_slow_body_is_given_up(server: Server, monkeypatch: pytest.MonkeyPatch) -> None:
    head = "POST / HTTP/1.1\r\nHost: 127.0.0.1:{port}\r\nX-Vfoa-Token: {token}\r\nContent-Length: 50\r\n\r\nhalf"
    with monkeypatch.context() as patch, server.connect(head) as connection:
        patch.setattr(guard, "REQUEST_S", 0.2)
        try:
            answer = connection.recv(1000)
        except ConnectionResetError:
            answer = b""
        assert answer == b""
    assert _answered(server)


@pytest.mark.parametrize("said", ["", "GET / HTTP/1.1\r\nHost: ", "POST / HTTP/1.1\r\nContent-Length: 9\r\n\r\n"])
def test_many_connections_that_say_nothing_leave_it_reachable(
    server: Server, said: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(guard, "REQUEST_S", 600.0)  # it is the number that is bounded here
    with ExitStack() as stack:
        for _ in range(3 * guard.MOST_CONNECTIONS):
            stack.enter_context(server.connect(said))
        assert _answered(server)
        annotating.wait_for(lambda: _connections(server) <= guard.MOST_CONNECTIONS)
        assert _answered(server)


FLOODED = """
import resource, sys
from pathlib import Path
from harness.server.local_server import LocalServer
from harness.record.web_app import site

resource.setrlimit(resource.RLIMIT_NOFILE, (400, 400))
server = LocalServer(site({}, {}, page=lambda: "here"))
print(server.address, flush=True)
server.run()
"""


def test_a_burst_of_connections_says_nothing_and_leaves_it_reachable() -> None:
    """A burst beyond its file descriptors, while they are accepted."""
    environment = {**os.environ, "PYTHONPATH": str(REPOSITORY)}
    command = [sys.executable, "-c", FLOODED]
    with (
        subprocess.Popen(command, env=environment, stdout=PIPE, stderr=PIPE, text=True) as process,
        ExitStack() as stack,
    ):
        stack.callback(process.terminate)
        assert process.stdout
        server = Server(process.stdout.readline().strip(), (), None)
        for _ in range(900):
            connection = stack.enter_context(socket.socket())
            connection.setblocking(False)
            connection.connect_ex(("127.0.0.1", server.port))
        assert _answer_after_a_while(server) == "here"
        process.terminate()
        said = process.communicate()[1]
    assert said == ""


def _answer_after_a_while(server: Server, patience_s: float = 20.0) -> str:
    """What the server answers when it has worked off a burst; it may close what comes meanwhile."""
    until = time.monotonic() + patience_s
    while True:
        try:
            return server.ask("/", **server.known()).text
        except OSError:
            assert time.monotonic() < until
            time.sleep(0.2)


def _connections(server: Server) -> int:
    ours = [each for each in psutil.Process().net_connections() if each.laddr and each.laddr.port == server.port]
    return len([each for each in ours if each.status == "ESTABLISHED"])


def test_a_connection_that_says_nothing_is_closed(server: Server, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(guard, "REQUEST_S", 0.2)
    for said in ("", "GET / HTTP/1.1\r\nHost: "):
        with server.connect(said) as connection:
            answer = b""
            with suppress(ConnectionResetError):  # closed as well
                answer = connection.recv(1000)
            assert answer == b""


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
