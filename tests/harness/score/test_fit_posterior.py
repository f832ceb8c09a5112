"""`vfoa fit` from a run to the file that another run takes as a preset."""

from __future__ import annotations

from pathlib import Path

import pytest

from harness.cli.fit import fit
from harness.clips.add import add_clip
from harness.run.experiment import load_experiment
from harness.run.fitted_settings import read_fitted
from tests.disk import write_text
from tests.measured import EXPERIMENT, measured_tables, true_labels
from vfoa.bayes import BayesSettings
from vfoa.errors import VfoaError

TWO_CLIPS = EXPERIMENT.replace('"talk"', '"one", "two"').replace('attention.smoothing = "forward"\n', "")


@pytest.fixture
def fitted(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """A file of settings, fitted on two clips in which heads and gaze point exactly where people look."""
    monkeypatch.chdir(tmp_path)
    for name in ("one", "two"):
        add_clip(measured_tables(tmp_path / "data" / name), name=name)
        write_text(tmp_path / "annotations" / f"{name}.csv", true_labels())
    write_text(tmp_path / "talk.toml", TWO_CLIPS)
    fit("talk.toml", Path("fitted.toml"), None)
    return Path("fitted.toml")


def test_a_fit_says_what_it_rests_on_and_what_it_is_worth(fitted: Path) -> None:
    found = read_fitted(fitted)
    values = {each.name: each for each in found.fit.value}
    assert (found.fit.experiment, found.fit.clips) == ("talk", ("one", "two"))
    assert (values["gaze_error_deg"].value, values["gaze_error_deg"].n) == (pytest.approx(0, abs=0.5), 24)
    assert values["head_share"].value == pytest.approx(1, abs=0.05)
    assert values["head_share"].low is not None
    assert [(each.clip, each.n) for each in found.fit.held_out] == [("one", 24), ("two", 24)]


def test_the_file_is_a_preset_of_posteriors_alone(fitted: Path) -> None:
    cones, forward = load_experiment("talk.toml", preset=str(fitted)).configurations
    assert cones.attend.attention.method == "cones"
    assert isinstance(forward.attend.attention, BayesSettings)
    assert forward.attend.attention.head_share == pytest.approx(1, abs=0.05)
    assert forward.attend.attention.spread == "published"


def test_a_table_says_whether_it_reports_a_clip_that_was_fitted_on(fitted: Path) -> None:
    on_itself = load_experiment("talk.toml", preset=str(fitted)).notes
    assert on_itself == ("FITTED ON WHAT IS REPORTED: the settings of fitted.toml were fitted on one, two.",)
    elsewhere = load_experiment("talk.toml", clips=("three",), preset=str(fitted)).notes
    assert elsewhere == ("Settings of fitted.toml, fitted on other clips: one, two.",)


def test_a_wrong_key_is_named(fitted: Path) -> None:
    fitted.write_text(fitted.read_text().replace("[attention]", "[attention]\nhead_shear = 1"))
    with pytest.raises(VfoaError, match=r"attention.*head_shear"):
        load_experiment("talk.toml", preset=str(fitted))


def test_clips_without_labels_cannot_be_fitted(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(tmp_path)
    add_clip(measured_tables(tmp_path / "data" / "one"), name="one")
    write_text(tmp_path / "talk.toml", TWO_CLIPS.replace('"one", "two"', '"one"'))
    with pytest.raises(VfoaError, match="fit: talk: no labelled frame"):
        fit("talk.toml", None, None)
