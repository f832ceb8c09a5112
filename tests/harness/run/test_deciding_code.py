"""A run is another run when code that decides its results is another one, and only then."""

from __future__ import annotations

import sys
from pathlib import Path

import pytest

from harness.files.digests import code_digest, import_closure, own_code_digest
from harness.pipeline.configuration import METHODS
from harness.run import scene_identity
from harness.run.experiment import load_experiment
from harness.run.plan import describe, prepare


def test_what_decides_results_is_the_loop_the_stages_and_the_adapters() -> None:
    plan = prepare(load_experiment("demo", clips=("studio_table",)), limit=1)
    modules = import_closure(plan.deciding_modules)[0]
    assert {"harness.run.loop", "vfoa.cones", "vfoa.stereo.block_matching", "harness.studio.clip"} <= modules.keys()
    assert {"harness.run.records", "harness.pipeline.ground_truth", "harness.clips.naming"} <= modules.keys()
    rooms = {name.split(".")[1] for name in modules if name.startswith("harness.")}
    assert not rooms & {"annotate", "bench", "cli", "score", "record", "report", "api"}
    assert describe(plan).source_sha256 == code_digest(plan.deciding_modules)


def test_scenes_depend_on_what_perceives_and_on_no_method() -> None:
    modules = import_closure(scene_identity._PLACED_BY)[0].keys() | {*scene_identity._WRITTEN_BY}
    assert {"vfoa.reconstruction", "harness.run.scenes", "harness.pipeline.perception"} <= modules
    assert {"vfoa.tracking", "vfoa.instance_tracking", "vfoa.divided_people", "vfoa.depth_memory"} <= modules
    assert {"harness.clips.naming"} <= modules
    assert not modules & {place.partition(":")[0] for place in METHODS.builtin.values()}
    with pytest.raises(ValueError, match=r"no such module: harness\.run\.seens"):
        own_code_digest(("harness.run.scenes", "harness.run.seens"))


def test_modules_of_folders_without_init_count_though_nothing_has_imported_them(tmp_path: Path, monkeypatch) -> None:
    monkeypatch.syspath_prepend(str(tmp_path))
    inner = tmp_path / "decides" / "inner" / "most"
    inner.mkdir(parents=True)
    (inner / "stage.py").write_text("from decides.inner import other\n")
    (inner.parent / "other.py").write_text("")
    found, _ = import_closure(("decides.inner.most.stage",))
    assert found == {"decides.inner.most.stage": inner / "stage.py", "decides.inner.other": inner.parent / "other.py"}
    assert "decides" not in sys.modules


def test_a_comment_counts_where_it_decides_and_nowhere_else(tmp_path: Path, monkeypatch) -> None:
    monkeypatch.syspath_prepend(str(tmp_path))
    package = tmp_path / "decided"
    package.mkdir()
    for name, text in {"__init__": "", "stage": "from decided import steps\n", "steps": "", "page": ""}.items():
        (package / f"{name}.py").write_text(text)

    def digest() -> str:
        code_digest.cache_clear()
        return code_digest(("decided.stage", "harness.run.loop"))

    before = digest()
    (package / "page.py").write_text("# of the page")
    assert digest() == before
    (package / "steps.py").write_text("# of a step")
    assert digest() != before
