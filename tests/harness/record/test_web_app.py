from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path

import httpx
import pytest

from harness.record.composed import Composed
from harness.record.web_app import open_path, site
from harness.record.web_viewer import WebFile
from tests.web import running
from vfoa.errors import VfoaError

FILES = {"clip__it's two": "clip__it's two.rrd", "bad": "bad.txt"}
PAGE = "<!doctype html><title>page</title>"


class Addresses:
    """A catalogue that says what it was asked."""

    origin = "http://127.0.0.1:9"

    def address(self, recording: Composed, frame: int | None) -> str:
        if recording.files[0].suffix != ".rrd":
            raise VfoaError(f"{recording.files[0]}: not a recording")
        return f"rerun+http://127.0.0.1:9/{recording.name}#when=frame@{frame}"


@pytest.fixture(scope="module")
def client() -> Iterator[httpx.Client]:
    recordings = {name: Composed(name=name, files=(Path("run") / file,)) for name, file in FILES.items()}
    viewer = {"index.html": WebFile(content=b"<canvas>", media_type="text/html")}
    app = site(recordings, Addresses(), viewer, page=lambda: PAGE)
    with running(app) as address, httpx.Client(base_url=address, trust_env=False) as client:
        yield client


def test_a_recording_opens_in_the_viewer_at_a_frame(client: httpx.Client) -> None:
    answer = client.get(open_path("clip__it's two", -3))
    assert answer.is_redirect
    assert answer.next_request is not None
    target = answer.next_request.url
    assert (target.host, target.path) == ("127.0.0.1", "/viewer/")
    assert target.params["url"] == "rerun+http://127.0.0.1:9/clip__it's two#when=frame@-3"
    assert client.get(open_path("clip__it's two", None)).headers["location"].endswith("None")


def test_without_a_page_the_first_recording_is_in_front() -> None:
    with running(site({"one": Composed(name="one", files=(Path("one.rrd"),))}, Addresses(), {})) as address:
        assert httpx.get(address, trust_env=False).headers["location"] == "/open?recording=one"


@pytest.mark.parametrize("host", ["evil.example", "evil.example:8000", "127.0.0.1.evil.example", "192.168.1.2", ""])
def test_a_request_to_another_name_is_refused(client: httpx.Client, host: str) -> None:
    for path in ("/", "/viewer/", "/open?recording=bad"):
        assert client.get(path, headers={"Host": host}).status_code == 400


@pytest.mark.parametrize("host", ["127.0.0.1", "127.0.0.1:8000", "localhost:8000", "LOCALHOST"])
def test_this_machines_own_names_are_served(client: httpx.Client, host: str) -> None:
    assert client.get("/", headers={"Host": host}).text == PAGE


@pytest.mark.parametrize("method", ["POST", "PUT", "DELETE", "PATCH"])
def test_nothing_but_reading_is_allowed(client: httpx.Client, method: str) -> None:
    for path in ("/", "/open?recording=bad", "/viewer/"):
        assert client.request(method, path).status_code == 405


@pytest.mark.parametrize(
    ("path", "status"),
    [
        ("/viewer/../../etc/passwd", 404),
        ("/viewer/..%2f..%2fetc%2fpasswd", 404),
        ("/viewer/%2e%2e/page.py", 404),
        ("/etc/passwd", 404),
        ("/open?recording=../run/clip", 404),
        ("/open", 404),
        ("/open?recording=bad&frame=5", 500),
        ("/open?recording=clip__it's%20two&frame=x", 400),
        ("/open?recording=clip__it's%20two&frame=99999999999999999999", 400),
        ("/open?recording=clip__it's%20two&frame=%0d%0aSet-Cookie:a", 400),
    ],
)
def test_what_is_not_there_is_not_given(client: httpx.Client, path: str, status: int) -> None:
    answer = client.get(path)
    assert answer.status_code == status
    assert "root:" not in answer.text


def test_the_viewer_may_ask_the_catalogue_and_nobody_else(client: httpx.Client) -> None:
    policy = dict(each.split(" ", 1) for each in client.get("/viewer/").headers["content-security-policy"].split("; "))
    assert policy["connect-src"] == "'self' http://127.0.0.1:9"
    assert policy["default-src"] == "'none'"
