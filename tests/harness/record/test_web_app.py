"""The files that the server of recordings gives; whom it answers is in tests/harness/server/test_servers.py."""

from __future__ import annotations

import json
from collections.abc import Iterator

import httpx
import pytest

from harness.record.composed import Composed, find_clips
from harness.record.viewer import page_files
from harness.record.web_app import failures_routes, open_path, site
from harness.score.verdicts import Verdict
from harness.server.guard import TOKEN_HEADER
from tests.harness.record.conftest import CONFIGURATION, four_frames, write_run
from tests.web import running
from vfoa.errors import VfoaError

PAGE = "<!doctype html><title>page</title>"
NAME = "clip__it's two"


@pytest.fixture(scope="module")
def client(tmp_path_factory: pytest.TempPathFactory) -> Iterator[httpx.Client]:
    """A recording of three layers, one that is broken, one that is gone, and files beside them."""
    recorded = write_run(tmp_path_factory.mktemp("web") / "run", {CONFIGURATION: four_frames()})
    (broken := recorded.run / "broken.rrd").write_bytes(b"RRF2 and no more")
    recordings = {
        NAME: find_clips(recorded.run, None, None)[0].compose(),
        "bad": Composed(name="bad", files=(broken,)),
        "gone": Composed(name="gone", files=(recorded.run / "gone.rrd",)),
    }

    def page(where: str) -> str:
        if where == "cup":
            raise VfoaError("--where: found 'cup'")
        return PAGE + where

    with running(site(recordings, page_files(), page=page)) as server:
        headers = {TOKEN_HEADER: server.address.partition("token=")[2]}
        with httpx.Client(base_url=f"http://127.0.0.1:{server.port}", headers=headers, trust_env=False) as client:
            client.recorded = recorded  # type: ignore[attr-defined]
            yield client


def test_a_recording_opens_in_the_viewer_at_a_frame(client: httpx.Client) -> None:
    answer = client.get(open_path(NAME, -3))
    assert answer.next_request is not None
    target = answer.next_request.url
    assert (target.host, target.path, target.params["frame"]) == ("127.0.0.1", "/viewer/", "-3")
    given = [client.get(url).content for url in target.params.get_list("files")]
    assert given == [path.read_bytes() for path in client.recorded.paths]  # type: ignore[attr-defined]
    assert client.get(target.params["layout"]).content.startswith(b"RRF2")
    assert "viewer.js" in client.get(target).text
    assert "frame" not in client.get(open_path(NAME, None)).headers["location"]


def test_the_list_of_failures_tells_another_object_of_the_true_name_from_the_true_one() -> None:
    told = {"clip": "clip", "configuration": "one", "subject": "ann", "truth": "cup", "outcome": "wrong"}
    wrong = [
        Verdict(frame=frame, predicted=predicted, error_type="missed", **told)
        for frame, predicted in enumerate(("cup", "book", None))
    ]
    routes = failures_routes(lambda: wrong, {("clip", "one"): Composed(name="clip", files=())})
    (listed,) = (route for route in routes if route.path == "/failures.json")
    found = json.loads(listed.endpoint(None).body)
    assert [each["predicted"] for each in found] == ["cup (another of this name)", "book", None]


def test_a_recording_is_given_in_parts(client: httpx.Client) -> None:
    whole = client.recorded.paths[0].read_bytes()  # type: ignore[attr-defined]
    part = client.get("/files/0/0.rrd", headers={"Range": "bytes=10-19"})
    assert (part.status_code, part.content) == (206, whole[10:20])
    assert part.headers["content-range"] == f"bytes 10-19/{len(whole)}"


def test_the_page_is_made_for_the_conditions_that_are_asked_for(client: httpx.Client) -> None:
    assert client.get("/").text == PAGE
    assert client.get("/", params={"where": "target=cup"}).text == PAGE + "target=cup"
    refused = client.get("/", params={"where": "cup"})
    assert (refused.status_code, refused.text) == (400, "--where: found 'cup'\n")


def test_without_a_page_the_first_recording_is_in_front(client: httpx.Client) -> None:
    with running(site({"one": Composed(name="one", files=())}, {})) as server:
        headers = {TOKEN_HEADER: server.address.partition("token=")[2]}
        answer = httpx.get(f"http://127.0.0.1:{server.port}/", headers=headers, trust_env=False)
        assert answer.headers["location"] == "/open?recording=one"


@pytest.mark.parametrize("method", ["POST", "PUT", "DELETE", "PATCH"])
def test_nothing_but_reading_is_allowed(client: httpx.Client, method: str) -> None:
    for path in ("/", "/open?recording=bad", "/viewer/", "/files/0/0.rrd"):
        assert client.request(method, path).status_code == 405


@pytest.mark.parametrize(
    ("path", "status"),
    [
        ("/viewer/../../etc/passwd", 404),
        ("/viewer/..%2f..%2fetc%2fpasswd", 404),
        ("/viewer/%2e%2e/page.py", 404),
        ("/etc/passwd", 404),
        ("/files/0/..%2fmanifest.json", 404),
        ("/files/0/../manifest.json", 404),
        ("/files/0/9.rrd", 404),
        ("/files/9/0.rrd", 404),
        ("/files/9/layout.rbl", 404),
        ("/files/1/layout.rbl", 404),
        ("/files/2/0.rrd", 500),
        ("/files/0/-1.rrd", 404),
        ("/open?recording=../run/clip", 404),
        ("/open", 404),
        ("/open?recording=bad&frame=5", 500),
        ("/open?recording=gone&frame=5", 500),
        ("/open?recording=clip__it's%20two&frame=x", 400),
        ("/open?recording=clip__it's%20two&frame=99999999999999999999", 400),
        ("/open?recording=clip__it's%20two&frame=%0d%0aSet-Cookie:a", 400),
    ],
)
def test_what_is_not_there_is_not_given(client: httpx.Client, path: str, status: int) -> None:
    answer = client.get(path)
    assert answer.status_code == status
    assert "root:" not in answer.text


def test_the_viewer_may_ask_this_server_and_nobody_else(client: httpx.Client) -> None:
    policy = dict(each.split(" ", 1) for each in client.get("/viewer/").headers["content-security-policy"].split("; "))
    assert policy["connect-src"] == "'self'"
    assert policy["default-src"] == "'none'"
    assert "unsafe-inline" not in str(policy)
