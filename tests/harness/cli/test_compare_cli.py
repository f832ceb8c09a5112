from __future__ import annotations

import base64
import json
import re
import zlib
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from typer.testing import CliRunner

from harness.cli import app
from harness.score import compared_runs
from harness.score.intervals import ScoredFrames
from harness.score.rows import ScoreRows
from tests.disk import labels_text
from tests.records import answers, frame_record, subject_record, target_record, write_run
from vfoa.errors import VfoaError

LOOK, LOOKS = 50, 8  # two seconds each: none is joined with another
FRAMES = LOOK * LOOKS


@pytest.fixture(autouse=True)
def project(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """A working directory with one clip, whose labels say ``cup`` and ``can`` in turn."""
    for name in ("datasets", "annotations"):
        (tmp_path / name).mkdir()
    (tmp_path / "datasets" / "tabletop.toml").write_text(
        'name = "tabletop"\nadapter = "studio"\nlicence = "MIT"\n'
        '[subjects.girl]\ncategory = "person"\n[targets.cup]\ncategory = "cup"\n'
        '[targets.can]\ncategory = "can"\n'
    )
    (tmp_path / "annotations" / "tabletop.csv").write_text(
        labels_text(*(f"{LOOK * k + 1},{LOOK * (k + 1)},girl,{_target(k)}," for k in range(LOOKS)))
    )
    monkeypatch.chdir(tmp_path)


def _target(look: int) -> str:
    return "can" if look % 2 else "cup"


def _run(folder: Path, correct: int, configuration: str = "one", frames: range = range(1, FRAMES + 1)) -> str:
    """A finished run that is right in so many of the first 20 frames of every look, and in no other."""
    said = [_target(k // LOOK) if k % LOOK < correct else "none" for k in range(FRAMES)]
    records = [each for each in answers(said, clip="tabletop", configuration=configuration) if each.frame in frames]
    entry = {"name": "tabletop", "manifest": "", "notes": [], "frames": [record.frame for record in records]}
    write_run(folder, records, notes=[], clips=[entry], configurations={configuration: {}})
    return str(folder)


@dataclass(frozen=True)
class _Scored:
    """The scores of a run: of each configuration, so many right frames in one look of fifty frames in each clip.

    Below six clips there is one clip, and the looks are of several subjects.
    """

    looks: int
    right: int
    scored_configurations: tuple[str, ...] = ("bm-one", "bm-two", "sgbm-one", "sgbm-two")

    @property
    def rows(self) -> ScoreRows:
        return ScoreRows(())

    def frames_of(self, configuration: str) -> list[ScoredFrames]:
        return [
            ScoredFrames(
                clip=f"clip {k}" if self.looks >= 6 else "clip",
                subject=f"girl {k}",
                frames=np.arange(LOOK),
                looks=np.zeros(LOOK, dtype=np.intp),
                truth=np.full(LOOK, "cup", dtype=np.object_),
                correct=(np.arange(LOOK) < self.right).astype(np.intp),
            )
            for k in range(self.looks)
        ]


def test_a_significant_drop_fails_and_a_small_one_does_not(tmp_path: Path) -> None:
    before, worse = _run(tmp_path / "before", 20), _run(tmp_path / "worse", 8)
    little = _run(tmp_path / "little", 18)
    guard = ["--baseline", before, "--fail-on", "significant-drop"]
    assert CliRunner().invoke(app, ["compare", worse, *guard]).exit_code == 1
    assert CliRunner().invoke(app, ["compare", worse, "--baseline", before]).exit_code == 0
    guard[-1] = "significant-drop=5"
    assert CliRunner().invoke(app, ["compare", little, *guard]).exit_code == 0
    guard[-1] = "significant-drop=3"
    assert CliRunner().invoke(app, ["compare", little, *guard]).exit_code == 1


@pytest.mark.parametrize(
    ("looks", "kind", "ends"),
    [
        # ends: no change, 4 points less, all lost; 0 passes, 1 fails, None is refused
        (3, "significant-drop", (None, None, None)),
        (7, "significant-drop", (None, None, None)),  # four comparisons: 4 x 2 / 2^7 > 0.05
        (20, "significant-drop", (0, 1, 1)),
        (3, "drop=5", (0, 0, 1)),
        (7, "drop=5", (0, 0, 1)),
        (20, "drop=5", (0, 0, 1)),
        (7, "drop=3", (0, 1, 1)),
        (3, "possible-drop=5", (None, None, None)),
        (7, "possible-drop=5", (0, 0, 1)),
        (20, "possible-drop=5", (0, 0, 1)),
        (20, "possible-drop=3", (0, 1, 1)),
    ],
)
def test_a_check_passes_or_fails_by_its_kind_and_is_refused_where_it_cannot(
    monkeypatch: pytest.MonkeyPatch, looks: int, kind: str, ends: tuple[int | None, ...]
) -> None:
    for right, expected in zip((20, 18, 0), ends, strict=True):
        runs = {"before": _Scored(looks, 20), "after": _Scored(looks, right)}
        monkeypatch.setattr(compared_runs, "read_scores", lambda directory, where, runs=runs: runs[directory.path.name])
        done = CliRunner().invoke(app, ["compare", "after", "--baseline", "before", "--fail-on", kind])
        if expected is None:
            assert isinstance(done.exception, VfoaError)
            assert "cannot fail" in str(done.exception) or "cannot pass" in str(done.exception)
        else:
            assert done.exit_code == expected, done.output
            assert (f"vfoa: --fail-on {kind}: " in done.stderr) == bool(expected)


@pytest.mark.parametrize("kind", ["drop", "drop=", "drop=-1", "drop=x", "possible-drop=0", "drip=5", "drop=nan"])
def test_a_kind_of_check_is_refused_that_is_none(tmp_path: Path, kind: str) -> None:
    before, worse = _run(tmp_path / "before", 20), _run(tmp_path / "worse", 8)
    error = CliRunner().invoke(app, ["compare", worse, "--baseline", before, "--fail-on", kind]).exception
    assert isinstance(error, VfoaError)
    assert "expected significant-drop[=POINTS], drop=POINTS or possible-drop=POINTS" in str(error)


def test_a_significant_gain_does_not_fail(tmp_path: Path) -> None:
    before, better = _run(tmp_path / "before", 8), _run(tmp_path / "better", 20)
    said = CliRunner().invoke(app, ["compare", better, "--baseline", before, "--fail-on", "significant-drop", "--json"])
    assert said.exit_code == 0
    (one,) = json.loads(said.stdout)["comparisons"]
    assert (one["n"], one["better"], one["worse"]) == (FRAMES, 12 * LOOKS, 0)
    assert one["p"] == 2 / 2**LOOKS
    assert "significantly better" in one["sentence"]


def test_runs_side_by_side_are_told_apart_by_their_directory(tmp_path: Path) -> None:
    first, second = _run(tmp_path / "a", 8), _run(tmp_path / "b", 9)
    (one,) = json.loads(CliRunner().invoke(app, ["compare", first, second, "--json"]).stdout)["comparisons"]
    assert (one["reference"], one["configuration"]) == (f"{first}/one", f"{second}/one")


def test_changed_answers_are_those_that_are_counted(tmp_path: Path) -> None:
    """Another object of the true name is no answer of that name, and no hit where nobody looks at a thing is "none"."""
    (tmp_path / "annotations" / "tabletop.csv").write_text(
        "# vfoa annotations 1\nfirst_frame,last_frame,subject,target,note,u_px,v_px\n"
        "1,1,girl,cup,,5,5\n2,2,girl,none,,,\n"
    )
    cups = [target_record(1, "cup"), target_record(2, "cup", box_px=(50.0, 50.0, 60.0, 60.0))]
    for name, focus in (("then", (2, None)), ("now", (1, 2))):
        seen = [subject_record("girl", totals={each: 0.5} if each else {}, focus=each) for each in focus]
        records = [frame_record(cups, [each], frame=k, clip="tabletop") for k, each in enumerate(seen, start=1)]
        clip = {"name": "tabletop", "manifest": "", "notes": [], "frames": [1, 2]}
        write_run(tmp_path / name, records, notes=[], clips=[clip], configurations={"one": {}})
    done = CliRunner().invoke(app, ["compare", "now", "--baseline", "then", "--json"])
    changes = [(each["before"], each["after"], each["is_better"]) for each in json.loads(done.stdout)["changes"]]
    assert changes == [("cup (another of this name)", "cup", True), ("none", "cup", False)]


def test_several_runs_against_a_baseline_are_corrected_together(tmp_path: Path) -> None:
    before, *others = (_run(tmp_path / name, n) for name, n in (("before", 8), ("better", 14), ("same", 8)))
    said = CliRunner().invoke(app, ["compare", *others, "--baseline", before, "--json"])
    better, same = json.loads(said.stdout)["comparisons"]
    assert (better["p"], better["p_holm"]) == (2 / 2**LOOKS, 4 / 2**LOOKS)
    assert "p = 0.016, corrected for 2 comparisons: significantly better" in better["sentence"]
    assert (same["p"], same["p_holm"]) == (1, 1)


def test_runs_of_other_frames_cannot_be_compared_with_a_baseline(tmp_path: Path) -> None:
    first, second = (
        _run(tmp_path / name, 8, frames=frames) for name, frames in (("a", range(1, 11)), ("b", range(11, 21)))
    )
    error = CliRunner().invoke(app, ["compare", second, "--baseline", first]).exception
    assert isinstance(error, VfoaError)
    assert "configuration 'one' has no scored frame in common with" in str(error)


def test_the_served_page_links_to_recordings_and_is_made_anew_for_other_conditions(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    runs = [_run(tmp_path / "a", 8), _run(tmp_path / "b", 9)]
    for run in runs:
        (Path(run) / "tabletop__one.rrd").touch()
    served: dict[str, Any] = {}
    monkeypatch.setattr("harness.cli.serving.browse", lambda *given, **named: served.update(named, given=given))
    invoked = CliRunner().invoke(app, ["compare", *runs, "--serve", "--where", "target=cup", "--where", "frame<40"])
    assert invoked.exit_code == 0, invoked.output
    recordings, paths = served["given"]
    assert [*recordings] == ["1__tabletop__one", "2__tabletop__one"]
    assert paths == ["/?where=target%3Dcup%2Cframe%3C40"]

    def changed(where: str) -> dict[str, Any]:
        packed = re.search(r'id="pack-tables">(.*?)</script>', served["page"](where), re.DOTALL)
        assert packed is not None
        return json.loads(zlib.decompress(base64.b64decode(packed[1])))[0]

    every = changed("")
    assert [row[5] for row in every["rows"]] == [str(LOOK * k + 9) for k in range(LOOKS)]
    then, now = every["links"].values()
    assert then[0] == "/open?recording=1__tabletop__one&frame=9&subject=girl"
    assert now[1] == f"/open?recording=2__tabletop__one&frame={LOOK + 9}&subject=girl"
    assert [row[5] for row in changed("target=cup, frame<120")["rows"]] == ["9", str(2 * LOOK + 9)]
    assert 'value="target=cup, frame&lt;120"' in served["page"]("target=cup, frame<120")


@pytest.mark.parametrize(
    ("options", "said"),
    [
        (["--serve", "--json"], "--serve does not go with --page, --json and --fail-on"),
        (["--port", "80"], "--port and --no-open are for --serve"),
    ],
)
def test_options_of_the_server_that_do_not_fit_are_refused(tmp_path: Path, options: list[str], said: str) -> None:
    error = CliRunner().invoke(app, ["compare", _run(tmp_path / "a", 8), *options]).exception
    assert isinstance(error, VfoaError)
    assert said in str(error)


@pytest.mark.parametrize(
    ("arguments", "said"),
    [
        (["a", "--fail-on", "significant-drop"], "needs --baseline"),
        (["a", "a"], "given twice"),
        (["a", "--baseline", "b"], "has no configuration 'one'"),
    ],
)
def test_what_cannot_be_compared_is_said(tmp_path: Path, arguments: list[str], said: str) -> None:
    _run(tmp_path / "a", 8)
    _run(tmp_path / "b", 8, configuration="two")
    places = [str(tmp_path / argument) if argument in ("a", "b") else argument for argument in arguments]
    error = CliRunner().invoke(app, ["compare", *places]).exception
    assert isinstance(error, VfoaError)
    assert said in str(error)


def test_without_labels_there_is_one_line_and_no_table(tmp_path: Path) -> None:
    runs = [_run(tmp_path / name, 8) for name in ("a", "b")]
    (tmp_path / "annotations" / "tabletop.csv").write_text(labels_text())
    assert CliRunner().invoke(app, ["compare", *runs]).stdout == "Nothing is scored: no frame has a label.\n"


def test_many_configurations_are_compared_and_planned_in_few_rows_the_best_first(tmp_path: Path) -> None:
    names = [f"c{number}" for number in range(12)]
    records = []
    for right, name in enumerate(names):  # the last one is the best
        said = [_target(k // LOOK) if k % LOOK < 2 * right else "none" for k in range(FRAMES)]
        records += answers(said, clip="tabletop", configuration=name)
    entry = {"name": "tabletop", "manifest": "", "notes": [], "frames": [*range(1, FRAMES + 1)]}
    write_run(tmp_path / "many", records, notes=[], clips=[entry], configurations={name: {} for name in names})
    for command in ("compare", "plan"):
        said = CliRunner().invoke(app, [command, "many"], env={"COLUMNS": "200"}).stdout
        rows = re.findall(r"^ (c\d+) +(c\d+) ", said, re.MULTILINE)
        assert len(rows) == 40
        assert all("c11" in row for row in rows[:11])
        assert "40 of 66 pairs" in said
    assert len(json.loads(CliRunner().invoke(app, ["compare", "many", "--json"]).stdout)["comparisons"]) == 66
