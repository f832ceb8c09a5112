from __future__ import annotations

from scripts.worked_examples import example
from tests.plugins import install


def test_an_entity_of_another_package_is_in_the_recording(tmp_path, monkeypatch, frames, record_run, read_back):
    source = example("An entity in the recording")
    site = install(tmp_path / "site", "my_entity", source, group="vfoa.entities", name="people", cls="log_people_count")
    monkeypatch.syspath_prepend(str(site))
    counts = read_back(record_run(frames)).at("/attention/people", "Scalars:scalars")
    assert counts == {shown.frame.index: [len(shown.result.scene.people)] for shown in frames}
