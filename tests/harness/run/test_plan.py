"""The notes and errors of a run before it begins."""

from __future__ import annotations

import os
import subprocess
from pathlib import Path

import pytest

from harness.clips.manifest import load_manifest
from harness.pipeline.cache import open_cache
from harness.pipeline.cache_store import Store
from harness.run import plan as plans
from harness.run.experiment import load_experiment
from harness.run.plan import describe, prepare, source_commit
from tests.disk import write_text
from vfoa.errors import VfoaError


def test_names_by_the_sources_ids_are_doubted_where_a_network_numbers_the_masks() -> None:
    by_network, by_truth = (load_experiment(name, clips=("studio_talk",)) for name in ("default", "demo"))
    (note,) = map(str, prepare(by_network).experiment.notes)
    assert note.startswith(
        "studio_talk: the manifest finds anna, ben, mug, bear, bowl, plant by their ids in the source"
    )
    assert "differ from those of rf_detr_seg" in note
    assert prepare(by_truth).experiment.notes == by_truth.notes


def test_things_nearer_than_the_matchers_search_are_said_for_each_limit() -> None:
    """The table of studio_talk stands 1.2 m away and further."""
    near, far = (
        load_experiment("demo", clips=("studio_talk",), overrides=(f"stereo.min_depth_m={limit_m}",))
        for limit_m in (0.8, 2.0)
    )
    assert prepare(near).experiment.notes == near.notes
    (*_, note) = map(str, prepare(far).experiment.notes)
    assert note.startswith("studio_talk: ")
    assert "of the matches are nearer than stereo.min_depth_m = 2" in note


@pytest.mark.parametrize("other", ["moved/studio_table.toml", "studio_table.toml"])
def test_two_clips_of_one_name_are_refused(tmp_path: Path, monkeypatch: pytest.MonkeyPatch, other: str) -> None:
    """Their results would be in the same files of the run. Recordings of several days may have folders."""
    monkeypatch.chdir(tmp_path)
    text = load_manifest("studio_table").path.read_text(encoding="utf-8")
    paths = [write_text(tmp_path / path, text) for path in ("studio_table.toml", other)]
    experiment = load_experiment("demo", clips=("studio_table.toml", f"./{other}"))
    with pytest.raises(VfoaError, match=r"'studio_table'") as caught:
        prepare(experiment)
    assert all(str(path.relative_to(tmp_path)) in str(caught.value) for path in paths)


def test_clips_whose_names_differ_only_in_capitals_are_refused(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """macOS and Windows have one file for both."""
    monkeypatch.chdir(tmp_path)
    text = load_manifest("studio_table").path.read_text(encoding="utf-8")
    write_text(tmp_path / "Studio_Table.toml", text.replace('"studio_table"', '"Studio_Table"'))
    with pytest.raises(VfoaError, match="'studio_table' and 'Studio_Table'"):
        prepare(load_experiment("demo", clips=("studio_table", "Studio_Table.toml")))


def test_a_clips_content_is_digested_once_for_the_plan_and_the_cache(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    plan = prepare(load_experiment("demo", clips=("studio_table",)), limit=1)
    (one,) = plan.clips
    asked = []
    content = type(one.clip).digest
    monkeypatch.setattr(type(one.clip), "digest", lambda clip: asked.append(clip) or content(clip))
    described = describe(plan).clips[0].sha256
    cache = open_cache(Store(tmp_path, 10**9), "studio_table", one.clip, plan.experiment.configurations, one.digest)
    assert asked == [one.clip]
    assert {identity.parts["clip sha256"] for identity in cache.identities.values()} == {described}


def test_the_commit_is_read_without_writing_to_the_checkout(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """Another git command may run there, and a process that is killed would leave a lock behind."""

    def git(*words: str) -> str:
        author = ("-c", "user.name=ann", "-c", "user.email=ann@example.org")
        return subprocess.run(["git", *author, *words], cwd=tmp_path, capture_output=True, text=True, check=True).stdout

    monkeypatch.setattr(plans, "__file__", str(tmp_path / "harness" / "run" / "plan.py"))
    assert source_commit() is None
    file = write_text(tmp_path / "harness" / "run" / "plan.py", "one\n")
    git("init", "--quiet")
    git("add", ".")
    git("commit", "--quiet", "-m", "one")
    commit = git("rev-parse", "HEAD").strip()
    index = (tmp_path / ".git" / "index").read_bytes()
    os.utime(file, (1_700_000_000, 1_700_000_000))  # the same content, but another time than that in the index
    write_text(tmp_path / "notes.txt", "not of the source\n")
    assert source_commit() == commit
    assert (tmp_path / ".git" / "index").read_bytes() == index
    write_text(file, "two\n")
    assert source_commit() == f"{commit}-dirty"
