"""Labels that came with the program: read-only where they are installed, copied to where one works."""

from __future__ import annotations

import hashlib
import shutil
from pathlib import Path

import httpx
import pytest

from tests.annotating import served_by_the_program
from tests.repository import REPOSITORY

KEPT = shutil.ignore_patterns("__pycache__")


def _digests(folder: Path) -> dict[str, str]:
    """Every file and folder but the interpreter's own cache."""
    paths = (path for path in folder.rglob("*") if "__pycache__" not in path.parts)
    return {str(each): hashlib.sha256(each.read_bytes()).hexdigest() if each.is_file() else "" for each in paths}


@pytest.mark.parametrize("layout", ["installed", "checkout"])
def test_labelling_a_built_in_clip_changes_nothing_of_the_program(tmp_path: Path, layout: str) -> None:
    program, work = tmp_path / "program", tmp_path / "work"
    for name in ("vfoa", "harness"):
        shutil.copytree(REPOSITORY / name, program / name, ignore=KEPT)
    data = program / "harness" / "_data" if layout == "installed" else program
    for name in ("datasets", "annotations"):
        shutil.copytree(REPOSITORY / name, data / name, ignore=shutil.ignore_patterns(".journal"))
    if layout == "checkout":
        (program / "pyproject.toml").touch()
    work.mkdir()
    before = _digests(program)
    shipped = (data / "annotations" / "studio_talk.csv").read_text().splitlines()

    with served_by_the_program(work, "studio_talk", program) as (_, address), httpx.Client(timeout=60) as browser:
        browser.get(address, follow_redirects=True)
        host = address.partition("/?")[0]
        about, state = browser.get(f"{host}/api/clip").json(), browser.get(f"{host}/api/state").json()["state"]
        own = work / "annotations" / "studio_talk.csv"
        assert about["notice"].startswith("studio_talk came with vfoa and is read-only")
        assert state["labelled"] > 0
        assert not own.exists()
        subject = about["subjects"][0]
        change = {"kind": "range", "subject": subject, "at": 0, "last": 0, "target": "ignore"}
        answer = browser.post(f"{host}/api/change", json={"revision": state["revision"], "changes": [change]})
        assert answer.status_code == 200, answer.text
        rows = own.read_text().splitlines()
        assert [row for row in rows if f",{subject}," not in row] == [
            each for each in shipped if f",{subject}," not in each
        ]
        assert rows != shipped
        refused = browser.post(f"{host}/api/target", json={"name": "vase", "rule": {"category": "vase"}})
        assert "is read-only" in refused.json()["error"]

    assert _digests(program) == before
    assert not (data / "annotations" / ".journal").exists()
