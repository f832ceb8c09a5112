"""The answers of the labelling page's server; whom it answers is in tests/harness/server/test_servers.py."""

from __future__ import annotations

import errno
import http.client
import json
import os
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from tests.annotating import Page, serve
from tests.disk import HEIGHT, WIDTH, picture, write_image, write_text

READ = ("/", "/page/page.js", "/page/page.css", "/api/clip", "/api/state", "/api/scene/0", "/picture/left/0")
CHANGE = {"kind": "range", "subject": "ann", "at": 0, "last": 3, "target": "cup"}


def _changes(revision: object = 1, **values: object) -> dict[str, object]:
    """The body of a request with one change."""
    return {"revision": revision, "drawn": 1, "changes": [{**CHANGE, **values}]}


@pytest.fixture
def page(noise: Callable[..., Page]) -> Page:
    return noise()


def _ask(
    page: Page, path: str, *, method: str = "GET", body: bytes = b"", **headers: str
) -> tuple[int, dict[str, str], bytes]:
    """One request exactly as given: no client tidies the path or the host."""
    connection = http.client.HTTPConnection("127.0.0.1", page.port, timeout=20)
    try:
        connection.putrequest(method, path, skip_host="Host" in headers, skip_accept_encoding=True)
        for name, value in headers.items():
            connection.putheader(name.replace("_", "-"), value)
        connection.putheader("Content-Length", str(len(body)))
        connection.endheaders(body)
        answer = connection.getresponse()
        return answer.status, {name.lower(): value for name, value in answer.getheaders()}, answer.read()
    finally:
        connection.close()


def _post(page: Page, path: str, value: Any, **headers: str) -> tuple[int, Any]:
    status, _, body = _ask(
        page,
        path,
        method="POST",
        body=json.dumps(value).encode(),
        **{"Content_Type": "application/json", "X_Vfoa_Token": page.token, **headers},
    )
    return status, json.loads(body) if body.startswith(b"{") else body.decode()


def test_a_program_may_send_the_token_as_a_header(page: Page) -> None:
    assert all(_ask(page, path, X_Vfoa_Token=page.token)[0] == 200 for path in READ)


@pytest.mark.parametrize("host", ["127.0.0.1", "localhost", "[::1]"])
def test_loopback_names_are_answered(page: Page, host: str) -> None:
    here = f"{host}:{page.port}"
    assert _post(page, "/api/change", _changes(), Host=here, Origin=f"http://{here}")[0] == 200


@pytest.mark.parametrize(
    "path",
    [
        "/picture/left/12",
        "/picture/left/-1",
        "/picture/left/99999999999999999999",
        "/picture/left/..%2f..%2fdatasets%2fnoise.toml",
        "/picture/../datasets/noise.toml",
        "/picture/elsewhere/0",
        "/api/scene/12",
        "/page/../app.py",
        "/page/..%2fapp.py",
        "/page/%2e%2e/%2e%2e/annotations.py",
        "/page//etc/passwd",
        "/page/page.html%00",
        "//etc/passwd",
        "/datasets/noise.toml",
    ],
)
def test_nothing_outside_the_clip_is_served(page: Page, path: str) -> None:
    assert _ask(page, path, X_Vfoa_Token=page.token)[0] == 404


def test_the_policy_lets_the_page_load_nothing_from_elsewhere(page: Page) -> None:
    for path in (*READ, "/missing"):
        headers = _ask(page, path, X_Vfoa_Token=page.token)[1]
        policy = headers["content-security-policy"]
        assert "default-src 'none'" in policy
        assert "unsafe" not in policy
        assert "frame-ancestors 'none'" in policy
        assert headers["cache-control"] == "no-store"


def test_a_form_of_another_page_cannot_post(page: Page) -> None:
    for kind in ("text/plain", "application/x-www-form-urlencoded", "multipart/form-data"):
        assert _post(page, "/api/change", _changes(), Content_Type=kind)[0] == 415


@pytest.mark.parametrize(
    ("change", "found"),
    [
        ({"kind": "forget"}, "kind: "),
        ({"colour": "red"}, "unknown key 'changes.0.colour'"),
        ({"subject": "anna"}, "unknown subject 'anna'; did you mean 'ann'"),
        ({"target": "cups"}, "unknown target 'cups'; did you mean 'cup'"),
        ({"target": "ann"}, "'ann' looks at 'ann'"),
        ({"kind": "note", "note": "two\nlines"}, "control character"),
        ({"kind": "look", "target": None}, "unknown target ''"),
    ],
)
def test_a_wrong_change_is_one_line_and_changes_nothing(page: Page, change: dict[str, object], found: str) -> None:
    assert _post(page, "/api/change", _changes())[0] == 200
    before = page.file.read_bytes()
    status, answer = _post(page, "/api/change", _changes(2, **change))
    assert (status, found in answer["error"]) == (400, True), answer
    assert page.file.read_bytes() == before


def test_a_change_that_a_full_disk_does_not_take_is_answered_and_not_made(
    page: Page, monkeypatch: pytest.MonkeyPatch
) -> None:
    assert _post(page, "/api/change", _changes())[0] == 200
    before = page.file.read_bytes(), page.session.state()["tracks"]

    def full(*_: object) -> None:
        raise OSError(errno.ENOSPC, os.strerror(errno.ENOSPC))

    with monkeypatch.context() as patch:
        patch.setattr("os.fsync", full)
        status, answer = _post(page, "/api/change", _changes(2, target="book"))
        assert (status, "No space left on device" in answer["error"]) == (400, True), answer
        patch.setattr("os.fsync", lambda handle: None)
        patch.setattr("harness.labels.files.atomic_write", full)
        status, answer = _post(page, "/api/change", _changes(2, target="book"))
        assert (status, "the change was not made" in answer["error"]) == (400, True), answer
        status, answer = _post(page, "/api/target", {"name": "pen", "rule": {"category": "pen"}})
        assert status == 200, answer
        patch.setattr("harness.annotate.target_change.atomic_write", full)
        status, answer = _post(page, "/api/target", {"name": "ruler", "rule": {"category": "ruler"}})
        assert (status, "No space left on device" in answer["error"]) == (507, True), answer
    assert (page.file.read_bytes(), page.session.state()["tracks"]) == before
    assert _post(page, "/api/change", _changes(page.session.state()["revision"], target="book"))[0] == 200


def test_a_change_on_an_older_state_is_answered_with_the_newer_one(page: Page) -> None:
    assert _post(page, "/api/change", _changes())[0] == 200
    status, answer = _post(page, "/api/change", _changes(target="book"))
    assert status == 409
    assert answer["state"]["revision"] == 2
    assert answer["state"]["tracks"]["ann"][0][:3] == [0, 3, "cup"]


def test_a_request_that_is_too_large_is_refused(page: Page) -> None:
    assert _post(page, "/api/change", _changes(note="x" * 200_000))[0] == 413


def test_the_views_are_pictures_of_the_frame(page: Page) -> None:
    import cv2

    for view in ("left", "right", "disparity"):
        status, headers, body = _ask(page, f"/picture/{view}/3", X_Vfoa_Token=page.token)
        assert (status, headers["content-type"]) == (200, "image/jpeg")
        image = cv2.imdecode(np.frombuffer(body, np.uint8), cv2.IMREAD_COLOR)
        assert image is not None
        assert image.shape == (48, 64, 3)
    status, _, body = _ask(page, "/picture/head/3?subject=ann", X_Vfoa_Token=page.token)
    assert (status, b"no head found here" in body) == (404, True)


def test_a_clip_of_a_depth_camera_has_its_depth_and_no_right_view(tmp_path: Path) -> None:
    root = tmp_path / "depth_camera"
    write_image(root / "rgb" / "1.png", picture(1))
    write_image(root / "depth" / "1.png", np.full((HEIGHT, WIDTH), 2000, np.uint16))
    source = 'colour = "rgb"\ndepth = "depth"\ncamera = { fx_px = 50, cx_px = 31.5, cy_px = 23.5 }\n'
    named = '[subjects.ann]\ncategory = "person"\n[targets.cup]\ncategory = "cup"\n'
    text = f'name = "clip"\nadapter = "depth_folder"\nroot = "{root.as_posix()}"\n[source]\n{source}{named}'
    with serve(clip=str(write_text(tmp_path / "datasets" / "clip.toml", text))) as page:
        assert _ask(page, "/picture/disparity/0", X_Vfoa_Token=page.token)[0] == 200
        status, _, body = _ask(page, "/picture/right/0", X_Vfoa_Token=page.token)
    assert (status, b"this clip has no right view" in body) == (404, True)


def test_changes_that_come_together_are_made_in_order_and_again_only_if_they_were_not(page: Page) -> None:
    changes = [{**CHANGE, "id": str(at), "at": at, "last": at} for at in range(5)]
    assert _post(page, "/api/change", {"revision": 1, "drawn": 1, "changes": changes[:3]})[0] == 200
    status, answer = _post(page, "/api/change", {"revision": 1, "drawn": 1, "changes": changes})
    assert (status, answer["state"]["revision"]) == (200, 6)  # as of a page that never got the first answer
    assert answer["state"]["tracks"]["ann"][0][:3] == [0, 4, "cup"]
    draw = {"kind": "draw", "draw": {"do": "key", "name": "cup", "at": 0, "place": [1, 1, 9, 9]}}
    wrong = {**CHANGE, "target": "cups"}
    both = {"revision": 6, "drawn": 1, "changes": [draw, wrong, {**CHANGE, "target": "book"}]}
    status, answer = _post(page, "/api/change", both)
    assert (status, answer["state"]["revision"], len(answer["drawn"]["tracks"])) == (400, 6, 1)
