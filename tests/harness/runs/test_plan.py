"""What is said of a run before it begins."""

from __future__ import annotations

from harness.runs.experiment import load_experiment
from harness.runs.plan import prepare


def test_names_by_the_sources_ids_are_doubted_where_a_network_numbers_the_masks() -> None:
    by_network, by_truth = (load_experiment(name, clips=("studio_talk",)) for name in ("default", "demo"))
    (note,) = prepare(by_network).experiment.notes
    assert note.startswith(
        "studio_talk: the manifest finds anna, ben, mug, bear, bowl, plant by their ids in the source"
    )
    assert "not those of rf_detr_seg" in note
    assert prepare(by_truth).experiment.notes == by_truth.notes
