"""A label that is set right: the file, the table, the page and the recording of a run say the same."""

from __future__ import annotations

import io
import json
import re
import shlex
import shutil
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING
from urllib.parse import urljoin

import httpx
import pytest
from rerun.chunk import RrdReader
from starlette.applications import Starlette
from typer.testing import CliRunner

from harness import RunResults, load_run, run_experiment
from harness.annotate.actions import Action
from harness.annotate.app import PageServer
from harness.annotate.correction import PATH, Correction, LabelQuery, choices, correct, correction_routes
from harness.annotate.session import Session
from harness.cli import app
from harness.cli.failures import Chosen, step_through, wrong_verdicts
from harness.record import entities, viewer
from harness.record.composed import served_recordings
from harness.record.layers import ClipFiles, RecordingIds
from harness.record.reading import RecordingFile
from harness.record.viewer import page_files
from harness.record.web_app import failures_routes, open_path, site
from harness.report.write import report_page
from harness.run.directory import RunDirectory
from harness.score.finished_run import read_scores
from tests.browser import dead_buttons, is_gone, set_width, wait_for, wait_until_drawn
from tests.repository import REPOSITORY
from tests.web import running
from vfoa.errors import VfoaError
from vfoa.validation import parse

if TYPE_CHECKING:
    from selenium.webdriver import Chrome

EXPERIMENT = """
clips = ["{clip}"]
[defaults]
stereo.matcher = "truth"
segmentation.model = "truth"
heads.detector = "truth"
head_pose.model = "simulated"
gaze.model = "simulated"
gaze.error_deg = 0.0
[grid]
"attention.cones_cm" = {{ one = [10], two = [10, 25] }}
"""
FRAMES = 4


@pytest.fixture(scope="module")
def finished(tmp_path_factory: pytest.TempPathFactory) -> RunResults:
    """A run of a clip of one's own: anna looks at the mug in its first frames, and is seen to."""
    root = tmp_path_factory.mktemp("corrected")
    for folder, name in (("datasets", "desk.toml"), ("annotations", "desk.csv")):
        (root / folder).mkdir()
        text = (REPOSITORY / folder / name.replace("desk", "studio_table")).read_text(encoding="utf-8")
        (root / folder / name).write_text(text.replace("studio_table", "desk"), encoding="utf-8")
    experiment = root / "cones.toml"
    experiment.write_text(EXPERIMENT.format(clip=(root / "datasets" / "desk.toml").as_posix()), encoding="utf-8")
    return run_experiment(experiment, out=root / "run", limit=FRAMES, cache=False)


@pytest.fixture
def run(finished: RunResults, tmp_path: Path) -> Iterator[RunResults]:
    """The run, whose labels are put back after the test."""
    annotations = finished.path.parent / "annotations"
    files = (annotations / "desk.csv", finished.path.parent / "datasets" / "desk.toml")
    kept = {file: file.read_text(encoding="utf-8") for file in files}
    yield load_run(finished.path)
    if any(file.read_text(encoding="utf-8") != text for file, text in kept.items()):
        for file, text in kept.items():
            file.write_text(text, encoding="utf-8")
        finished.rescore()
    shutil.rmtree(annotations / ".journal", ignore_errors=True)


def _recorded(run: RunResults, configuration: str, lane: str) -> dict[int, str]:
    """A lane of anna's in the recording, by frame."""
    found: dict[int, str] = {}
    path = entities.verdict(configuration, "anna", lane)
    file = ClipFiles(run=run.path, clip="desk").verdicts(configuration)
    for chunk in RrdReader(file).stream().filter(content=path, has_timeline="frame"):
        batch = chunk.to_record_batch()
        states = batch.column("StateChange:state").to_pylist()
        found |= {f: s[0] for f, s in zip(batch.column("frame").to_pylist(), states, strict=True) if s}
    return found


def _agree(run: RunResults, truth: dict[int, str]) -> None:
    """The table and the recording of every configuration say what the labels say."""
    run = load_run(run.path)
    frames = run.frames.drop_duplicates(["configuration", "frame"])
    for configuration in run.configurations:
        told = frames[frames["configuration"] == configuration].set_index("frame")
        assert dict(told["truth"]) == truth
        assert _recorded(run, configuration, "truth") == truth
        assert _recorded(run, configuration, "verdict") == dict(told["outcome"])
        row = run.frr[(run.frr["configuration"] == configuration) & (run.frr["subject"] == "(all)")].iloc[0]
        assert row["wrong"] == (told["outcome"] == "wrong").sum()


def test_a_correction_is_in_the_labels_the_tables_and_the_recording(run: RunResults) -> None:
    _agree(run, dict.fromkeys(range(1, FRAMES + 1), "mug"))
    page = (run.path / "report.html").read_text(encoding="utf-8")
    path = correct(run.directory, Correction(clip="desk", subject="anna", target="vase", first=2, last=3))
    _agree(run, {1: "mug", 2: "vase", 3: "vase", 4: "mug"})
    assert "2,3,anna,vase," in path.read_text(encoding="utf-8").splitlines()
    assert (path.parent / ".journal" / "desk.jsonl").is_file()
    assert (run.path / "report.html").read_text(encoding="utf-8") != page


def test_a_copied_run_and_a_renamed_one_stay_whole(run: RunResults, tmp_path: Path) -> None:
    def ids(folder: Path) -> RecordingIds:
        files = [*folder.glob("*.rrd")]
        assert len(files) == 6  # images, a reconstruction; attention and verdicts of two configurations
        (shared,) = {RecordingFile(file).ids for file in files}
        return shared

    second = Path(shutil.copytree(run.path, tmp_path / "second"))
    correct(load_run(second).directory, Correction(clip="desk", subject="anna", target="vase", first=2, last=3))
    assert ids(second) == ids(run.path)
    _agree(load_run(second), {1: "mug", 2: "vase", 3: "vase", 4: "mug"})
    third = second.rename(tmp_path / "third")
    manifest = json.loads((third / "manifest.json").read_text())
    del manifest["run_id"]  # as a run of an earlier version
    (third / "manifest.json").write_text(json.dumps(manifest))
    correct(load_run(third).directory, Correction(clip="desk", subject="anna", target="mug", first=2, last=3))
    assert ids(third) == ids(run.path)
    _agree(load_run(third), dict.fromkeys(range(1, FRAMES + 1), "mug"))


def test_runs_of_one_name_in_two_folders_have_recordings_of_their_own(run: RunResults, tmp_path: Path) -> None:
    again = run_experiment(run.path.parent / "cones.toml", out=tmp_path / "run", limit=1)
    ((one,), (other,)) = ({RecordingFile(file).ids for file in each.path.glob("*.rrd")} for each in (run, again))
    assert one.recording != other.recording
    assert one.application != other.application  # the viewer keeps a layout for each


def _annotate(run: RunResults, monkeypatch: pytest.MonkeyPatch, change: Callable[[Session], None]) -> str:
    """``vfoa annotate --run`` in which a person makes a change; returns what it prints."""
    sessions: list[Session] = []
    real = Session.__init__

    def noted(self: Session, *arguments: object, **options: object) -> None:
        real(self, *arguments, **options)  # type: ignore[arg-type]
        sessions.append(self)

    def serve(server: PageServer) -> None:
        change(sessions[-1])
        server.close()

    clip = run.path.parent / "datasets" / "desk.toml"
    words = ["annotate", str(clip), "--run", str(run.path), "--config", "one", "--no-open"]
    with monkeypatch.context() as patch:
        patch.setattr(Session, "__init__", noted)
        patch.setattr(PageServer, "run", serve)
        return CliRunner().invoke(app, words, catch_exceptions=False).output


def test_a_renamed_target_leaves_the_rates_of_every_run_as_they_are(
    run: RunResults, monkeypatch: pytest.MonkeyPatch
) -> None:
    def rename(session: Session) -> None:
        session.change_target("mug", new_name="tumbler", key="9", colour="olive plain")
        suggested = session.about()["suggestions"]["anna"]
        assert {each[0] for each in suggested if each} == {"tumbler"}

    before = run.frr.drop(columns="unknown_names")
    said = _annotate(run, monkeypatch, rename)
    after = load_run(run.path)
    assert after.frr.drop(columns="unknown_names").equals(before)
    assert after.frr["unknown_names"].isna().all()
    assert "unknown to its manifest" not in said
    _agree(run, dict.fromkeys(range(1, FRAMES + 1), "tumbler"))
    assert set(after.frames["predicted"]) == {"tumbler"}
    assert not any("names in desk.toml" in note.text for note in read_scores(run.directory).notes)


def test_names_in_the_results_that_the_labels_do_not_know_are_told(
    run: RunResults, monkeypatch: pytest.MonkeyPatch
) -> None:
    said = _annotate(run, monkeypatch, lambda session: session.delete_target("mug", "vase"))
    assert "desk: the results name mug, unknown to its manifest and labels" in said
    frr = load_run(run.path).frr
    assert set(frr["unknown_names"]) == {"mug"}
    assert set(frr["correct"]) == {0}


@pytest.mark.parametrize(
    ("changed", "says"),
    [
        ({"subject": "ben"}, "unknown subject 'ben'"),
        ({"target": "cat"}, "unknown target 'cat'"),
        ({"target": "anna"}, "'anna' looks at 'anna'"),
        ({"last": 61}, "no frame 61; expected 1 to 60"),
        ({"clip": "table"}, "no clip 'table'"),
    ],
)
def test_what_the_clip_does_not_have_is_refused(run: RunResults, changed: dict[str, object], says: str) -> None:
    before = run.path.joinpath("report.html").read_bytes()
    given = {"clip": "desk", "subject": "anna", "target": "vase", "first": 2, "last": 3, **changed}
    with pytest.raises(VfoaError, match=re.escape(says)):
        correct(run.directory, Correction(**given))  # type: ignore[arg-type]
    assert run.path.joinpath("report.html").read_bytes() == before


def test_the_label_is_set_right_in_a_form_of_the_served_report(run: RunResults) -> None:
    site_of_run = Starlette(routes=correction_routes(run.directory))
    with running(site_of_run) as server, httpx.Client(trust_env=False, follow_redirects=True) as client:
        asked = {"clip": "desk", "subject": "anna", "frame": "2"}
        address = f"http://127.0.0.1:{server.port}{PATH}"
        assert client.get(address, params=asked).status_code == 403  # without the token
        client.headers["x-vfoa-token"] = server.address.partition("token=")[2]
        form = client.get(address, params=asked).text
        assert "<option>vase</option>" in form
        assert "<option>anna</option>" not in form
        wanted = {"clip": "desk", "subject": "anna", "target": "vase", "first": "2", "last": "3"}
        for wrong in ({"target": "cat"}, {"last": "61"}, {"first": "two"}, {"subject": ""}):
            assert client.post(address, data={**wanted, **wrong}).status_code == 400
        foreign = client.post(address, data=wanted, headers={"Origin": "http://elsewhere.example"})
        assert foreign.status_code == 403
        _agree(run, dict.fromkeys(range(1, FRAMES + 1), "mug"))
        assert "tables, page and recordings are updated" in client.post(address, data=wanted).text
    _agree(run, {1: "mug", 2: "vase", 3: "vase", 4: "mug"})
    (undo,) = re.findall("<code>vfoa (.*)</code>", form)  # also of a clip of another folder
    for words in (shlex.split(undo), ["score", str(run.path)]):
        assert CliRunner().invoke(app, words, catch_exceptions=False).exit_code == 0
    _agree(run, dict.fromkeys(range(1, FRAMES + 1), "mug"))


def test_no_label_of_a_run_that_goes_on_is_changed(run: RunResults, tmp_path: Path) -> None:
    """Its scores cannot be written."""
    labels = run.path.parent / "annotations" / "desk.csv"
    before, goes_on = labels.read_bytes(), RunDirectory(shutil.copytree(run.path, tmp_path / "run"))
    goes_on.write_manifest(run.directory.read_manifest().model_copy(update={"finished": None}))
    with pytest.raises(VfoaError, match="not finished"):
        correct(goes_on, Correction(clip="desk", subject="anna", target="vase", first=2, last=3))
    assert labels.read_bytes() == before


@pytest.fixture
def report(run: RunResults, browser: Chrome) -> Iterator[Chrome]:
    """The served report of the run in a browser; frames 2 and 3 are wrong."""
    correct(run.directory, Correction(clip="desk", subject="anna", target="vase", first=2, last=3))
    recordings = served_recordings(run.path)
    page = partial(report_page, run.directory, {pair: each.name for pair, each in recordings.items()})
    app = site(
        {recording.name: recording for recording in recordings.values()},
        page_files(),
        page=page,
        more=correction_routes(run.directory),
    )
    with running(app) as server:
        set_width(browser, 1400)
        browser.get(server.address)
        wait_until_drawn(browser)
        yield browser


def test_the_buttons_of_the_served_report_lead_to_a_written_label(run: RunResults, report: Chrome) -> None:
    def press(way: str, name: str) -> None:
        wait_for(lambda: report.find_elements(way, name))
        report.find_element(way, name).click()

    report.find_element("id", "timeline").send_keys("n")
    press("link text", "The label is wrong")
    ends = [report.find_element("name", name).get_property("value") for name in ("first", "last")]
    assert ends == ["2", "3"]  # the whole look
    press("link text", "Cancel")
    wait_until_drawn(report)
    before = report.current_url
    assert "frame=2" in before
    press("link text", "The label is wrong")
    report.find_element("css selector", "select").send_keys("mug")
    press("xpath", "//button[text()='Write the label']")
    wait_for(lambda: "tables, page and recordings are updated" in report.page_source)
    _agree(run, dict.fromkeys(range(1, FRAMES + 1), "mug"))
    press("link text", "Back to where you were")
    wait_until_drawn(report)
    assert report.current_url == before
    assert [each for each in report.get_log("browser") if each["level"] == "SEVERE"] == []


def test_no_button_of_the_report_is_dead(report: Chrome) -> None:
    report.execute_script("document.querySelectorAll('details').forEach((each) => { each.open = true; })")
    report.find_element("id", "timeline").send_keys("n")
    assert len(report.find_elements("css selector", "button, summary")) > 50
    assert dead_buttons(report, "button", "summary") == []
    assert [each for each in report.get_log("browser") if each["level"] == "SEVERE"] == []


def test_the_served_report_and_its_box_of_a_frame_fit_a_phone(report: Chrome) -> None:
    set_width(report, 390)
    report.find_element("id", "timeline").send_keys("n")
    wait_for(lambda: report.find_elements("link text", "The label is wrong"))
    assert report.execute_script("return document.documentElement.scrollWidth") <= 390
    widths = "const box = document.getElementById('frame'); return [box.scrollWidth, box.clientWidth];"
    content, visible = report.execute_script(widths)
    assert content <= visible


def test_a_person_can_look_at_everything_but_herself(run: RunResults) -> None:
    assert choices(run.directory, "desk", "anna") == (*("laptop", "mug", "book", "bottle", "vase", "none", "ignore"),)


def test_the_label_of_a_wrong_frame_is_set_right_by_keys(run: RunResults, monkeypatch: pytest.MonkeyPatch) -> None:
    correct(run.directory, Correction(clip="desk", subject="anna", target="vase", first=2, last=3))
    shown: list[int] = []

    @contextmanager
    def opened(**_: object) -> Iterator[Callable[..., None]]:
        yield lambda recording, frame, tabs: shown.append(frame)

    class Terminal(io.StringIO):
        def isatty(self) -> bool:
            return True

    monkeypatch.setattr(viewer, "opened", opened)
    said = iter(["n", "w", "mug"])  # of the whole look, frames 2 and 3
    monkeypatch.setattr("sys.stdin", Terminal())
    monkeypatch.setattr("typer.prompt", lambda *_, **__: next(said))
    step_through(run.path, Chosen(configuration="one"))
    assert shown == [2, 3]  # after the correction no frame is wrong
    _agree(run, dict.fromkeys(range(1, FRAMES + 1), "mug"))


def test_the_run_follows_what_is_labelled_in_the_page(run: RunResults, monkeypatch: pytest.MonkeyPatch) -> None:
    def label(session: Session) -> None:
        session.make(Action(kind="range", subject="anna", at=0, last=0, target="book"))

    assert "tables, page and recordings are updated" in _annotate(run, monkeypatch, label)
    _agree(run, {1: "book", 2: "mug", 3: "mug", 4: "mug"})
    assert "updated" not in _annotate(run, monkeypatch, lambda session: None)


@pytest.fixture
def failures(run: RunResults, browser: Chrome) -> Iterator[Chrome]:
    """The page of failures of the run, beside a viewer that does not start; frames 2 and 3 are wrong."""
    correct(run.directory, Correction(clip="desk", subject="anna", target="vase", first=2, last=3))
    recordings = served_recordings(run.path)
    more = (
        *failures_routes(lambda: wrong_verdicts(read_scores(run.directory), Chosen()), recordings),
        *correction_routes(run.directory),
    )
    app = site({recording.name: recording for recording in recordings.values()}, page_files(), more=more)
    with running(app) as server:
        browser.get(server.address)
        wait_for(lambda: browser.find_element("id", "place").text == "1 of 4")
        yield browser


def test_a_look_is_labelled_beside_the_viewer_and_the_next_failure_is_shown(run: RunResults, failures: Chrome) -> None:
    from selenium.webdriver import ActionChains
    from selenium.webdriver.support.select import Select

    def place() -> str | None:  # the page may be loaded anew meanwhile
        place: str | None = failures.execute_script("return document.getElementById('place')?.textContent.trim()")
        return place

    Select(failures.find_element("name", "configuration")).select_by_value("two")
    failures.find_element("id", "next").click()
    wait_for(lambda: place() == "2 of 2")
    ActionChains(failures).move_to_element(failures.find_element("tag name", "h1")).click().send_keys("w").perform()
    form = failures.find_element("id", "label")
    wait_for(lambda: "The label now: vase, frames 2 to 3." in form.text)
    first, last = (form.find_element("name", name) for name in ("first", "last"))
    assert (first.get_property("value"), last.get_property("value")) == ("2", "3")
    Select(form.find_element("name", "target")).select_by_value("mug")
    last.clear()
    last.send_keys("1")
    (write,) = form.find_elements("xpath", ".//button[text()='Write the label']")
    write.click()
    wait_for(lambda: "desk: frame 2 comes after frame 1" in form.text)
    first.clear()
    first.send_keys("3")
    last.clear()
    last.send_keys("3")
    write.click()
    wait_for(lambda: place() == "1 of 1")  # the filter and the place stay
    _agree(run, {1: "mug", 2: "vase", 3: "mug", 4: "mug"})


HELD_ANSWERS = """
const ask = window.fetch;
window.held = [];
window.fetch = (what, how) => !String(what).startsWith("/label.json") ? ask(what, how) : new Promise((resolve) => {
    held.push((frame) => resolve(Response.json(
        {subjects: ["anna"], subject: "anna", targets: ["mug"], target: "mug", first: frame, last: frame})));
});
"""


def test_the_form_beside_the_viewer_is_about_the_frame_that_is_shown(failures: Chrome) -> None:
    from selenium.webdriver import ActionChains

    def press(keys: str) -> None:
        ActionChains(failures).send_keys(keys).perform()

    def answered(number: int, frame: int) -> tuple[bool, str]:
        script = "const [number, frame, done] = arguments; held[number](frame); setTimeout(done, 100);"
        failures.execute_async_script(script, number, str(frame))
        return form.is_displayed(), str(form.find_element("name", "first").get_property("value"))

    form = failures.find_element("id", "label")
    failures.execute_script(HELD_ANSWERS)
    press("wnw")  # faster than the server answers
    assert failures.execute_script("return held.length") == 2
    assert answered(1, 3) == (True, "3")
    assert answered(0, 2) == (True, "3")
    failures.find_element("id", "next").click()
    press("wn")
    assert answered(2, 2) == (False, "3")


@pytest.mark.parametrize("back", ["http://elsewhere.example", "//elsewhere.example", "/\\\\elsewhere.example"])
def test_the_form_leads_to_no_other_server(back: str) -> None:
    with pytest.raises(VfoaError, match="back"):
        parse(LabelQuery, {"clip": "desk", "back": back}, "label")


def test_a_recording_of_the_run_is_labelled_from_its_page(run: RunResults, browser: Chrome) -> None:
    from selenium.webdriver.support.select import Select

    recordings = served_recordings(run.path)
    more = correction_routes(run.directory)
    app = site({recording.name: recording for recording in recordings.values()}, page_files(), more=more)
    with running(app) as server:
        browser.get(server.address)
        browser.get(urljoin(server.address, open_path("desk__one", 3, "anna")))
        opens = browser.find_element("id", "opens")
        wait_for(opens.is_displayed)
        opens.click()
        form = browser.find_element("id", "label")
        wait_for(lambda: f"The label now: mug, frames 1 to {FRAMES}." in form.text)
        Select(form.find_element("name", "target")).select_by_value("vase")
        last = form.find_element("name", "last")
        last.clear()
        last.send_keys("2")
        form.find_element("xpath", ".//button[text()='Write the label']").click()
        wait_for(partial(is_gone, form))  # the page is loaded again, with the new content
    _agree(run, {1: "vase", 2: "vase", 3: "mug", 4: "mug"})
