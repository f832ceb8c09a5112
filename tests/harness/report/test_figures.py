"""Figures for a paper: every clip, configuration, legend and axis title is in them, as SVG and PDF in two widths."""

from __future__ import annotations

import re
from dataclasses import replace
from pathlib import Path

import matplotlib as mpl
import numpy as np
import pytest
from matplotlib.figure import Figure

from harness.labels.labels import Label
from harness.record.frame_reading import FrameContent
from harness.report.figures import charts
from harness.report.figures.files import WIDTHS_INCH, Figures, Wanted, figures_of, write_figures
from harness.report.figures.strip import WrongFrame, strip
from harness.report.figures.style import OFF, RIGHT, canvas, saved, styled
from harness.run.directory import RunDirectory
from harness.run.fitted import MethodScore
from harness.run.manifest import AnswerTraits
from harness.run.records import renamed
from harness.score.fit_logit import COMMONEST, DEFAULT, FITTED
from tests.command import vfoa
from tests.disk import labels_text
from tests.frame_by_frame import judge
from tests.harness.record.conftest import ANN, four_frames
from tests.harness.record.conftest import write_run as write_recorded
from tests.records import answers, fit_record, labels, write_clip, write_manifest, write_run
from vfoa.errors import VfoaError

CLIPS = [f"clip_{number:02}" for number in range(4)]
LABELLED = ("cup", "book", "cup", "none", "cup", "book")
SAID = {
    "cones": ("cup", "book", "book", "cup", None, "book"),
    "sure -- $x$": ("cup", "book", "cup", "none", "book", "cup"),
}
"""What two configurations say; a name may have signs of SVG's comments and of formulas."""


def _one_column(patch: pytest.MonkeyPatch) -> None:
    """Make figures of one width alone: to lay out all files of a run takes seconds."""
    patch.setattr("harness.report.figures.files.WIDTHS_INCH", {"1col": WIDTHS_INCH["1col"]})


@pytest.fixture
def no_pdf(monkeypatch: pytest.MonkeyPatch) -> None:
    """Figures of one width as SVG alone: to embed fonts takes long, too."""
    _one_column(monkeypatch)
    monkeypatch.setattr("harness.report.figures.files.FORMATS", ("svg",))


@pytest.fixture(scope="module")
def run(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A finished run of four clips under two configurations, of which the second gives probabilities."""
    root = tmp_path_factory.mktemp("figures")
    clips = [write_clip(root, clip, LABELLED) for clip in CLIPS]
    said = [answers(names, clip=clip, configuration=name) for clip in CLIPS for name, names in SAID.items()]
    methods = {name: {"probabilistic": name != "cones", "says_nowhere": name != "cones"} for name in SAID}
    records = (record for of_pair in said for record in of_pair)
    return write_run(root / "run", records, clips=clips, methods=methods).path


@pytest.fixture(scope="module")
def figures(run: Path) -> Figures:
    """The run's figures."""
    return figures_of([run])


@pytest.fixture(scope="module")
def files(run: Path, figures: Figures) -> Path:
    """A folder with two of the run's figures, of one width."""
    folder, chosen = run.parent / "out", ("frr", "confusion")
    with pytest.MonkeyPatch.context() as patch:
        _one_column(patch)
        written = write_figures(Figures(drawn={name: figures.drawn[name] for name in chosen}), folder)
    assert {*written} == {folder / f"{name}_1col.{kind}" for name in chosen for kind in ("svg", "pdf")}
    return folder


def _texts(svg: str) -> set[str]:
    """The texts of an SVG, which are outlines, with each text as a comment beside them."""
    return set(re.findall(r"<!-- (.*?) -->", svg))


EXPECTED = {
    "frr": {"FRR, 95 % interval", "best simple rule", "focus recognition rate (%)", "cones", "50.0", "66.7"},
    "frr_by_clip": {*CLIPS, "cones", "focus recognition rate (%), 95 % interval", "clip"},
    "error_types": {"cones", "M  missed", "S  no subject", "wrong frames (% of the labelled ones)"},
    "confusion": {"cup", "book", "none", "no prediction", "ground truth", "answer (framed: the right one)"},
    "calibration": {"calibrated", "confidence (%)", "right (% of the frames)"},
}


@pytest.mark.parametrize("width", WIDTHS_INCH.values())
@pytest.mark.parametrize("name", EXPECTED)
def test_names_legend_and_axis_titles_are_inside_and_nothing_is_cut(figures: Figures, name: str, width: float) -> None:
    assert [note.partition(":")[0] for note in figures.missing] == ["learning_curve", "failure"]
    with styled():
        figure = figures.drawn[name](width)
        svg = saved(figure, "svg").decode()  # lays it out
    texts = _texts(svg)
    assert EXPECTED[name] - texts == set()
    assert any("$x$" in text for text in texts)
    assert f'width="{72 * width:g}pt"' in svg
    assert "<text" not in svg  # outlines: no font of the reader's machine
    inside = figure.bbox.padded(1)
    tight = figure.get_tightbbox().transformed(figure.dpi_scale_trans)
    assert inside.x0 <= tight.x0
    assert inside.x1 >= tight.x1
    assert inside.y0 <= tight.y0
    assert inside.y1 >= tight.y1
    boxes = [axes.get_window_extent() for axes in figure.axes]
    assert not any(legend.get_window_extent().overlaps(box) for legend in figure.legends for box in boxes)


def test_fonts_are_embedded(files: Path) -> None:
    for file in files.glob("*.pdf"):
        pdf = file.read_bytes()
        assert pdf.startswith(b"%PDF-"), file
        assert pdf.count(b"/FontFile2 ") == pdf.count(b"/Type /FontDescriptor") > 0, file
        assert b"/CreationDate" not in pdf, file


def _not_fitted(*_: object) -> None:
    raise VfoaError("a fit takes seconds")


def test_several_runs_share_a_figure(run: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("harness.report.figures.files.read_labelled", _not_fitted)
    copy = tmp_path / "copy"
    copy.mkdir()
    for file in run.iterdir():
        (copy / file.name).symlink_to(file)
    with styled():
        (axes,) = figures_of([run, copy]).drawn["frr"](3.5).axes
    configurations = [f"{each}: {name}" for each in ("run", "copy") for name in SAID]
    assert [label.get_text() for label in axes.get_yticklabels()] == configurations


def test_the_learning_curve_has_every_point_and_both_levels() -> None:
    points = {"20 s": 0.5, "60 s": 0.6}
    levels = {f"{FITTED}, forward": 0.75, f"{DEFAULT}, forward": 0.55, COMMONEST: 0.2}
    fit = fit_record(
        labelled_s=90.5,
        held_out=tuple(MethodScore(method=name, n=9, frr=frr) for name, frr in levels.items()),
        curve=tuple(MethodScore(method=name, n=9, frr=frr) for name, frr in points.items()),
    )
    with styled():
        (axes,) = charts.learning_curve([("", fit)], 3.5).axes
    curve, *lines = axes.get_lines()
    assert curve.get_xdata().tolist() == [20, 60, 90.5]
    assert curve.get_ydata().tolist() == pytest.approx([50, 60, 75])
    assert [line.get_ydata()[0] for line in lines] == pytest.approx([55, 20])
    assert [label.get_text() for label in axes.get_xticklabels()] == ["20", "60", "90.5"]


def test_a_confusion_of_many_names_keeps_the_frequent_ones() -> None:
    names = [f"name {number}" for number in range(30)]
    truth = [name for number, name in enumerate(names) for _ in range(1 + number)]
    records = answers(truth)
    labelled = labels(*truth)
    verdicts = [judge(record, "girl", labelled.at(record.frame, "girl")) for record in records]
    with styled():
        axes = charts.confusion({"one": verdicts}, 3.5).axes[0]
    shown = [label.get_text() for label in axes.get_yticklabels()]
    assert shown == [*names[6:], "(other)"]
    framed = {int(max(line.get_ydata())) for line in axes.get_lines()}
    assert framed == {*range(24)}  # answers that share a name with the truth are not all right


def test_a_confusion_names_the_answers_that_are_never_right() -> None:
    truth, given = ["cup", "book", "cup"], ["cup", "dragon", "dragon"]
    verdicts = [judge(record, "girl", labels(*truth).at(record.frame, "girl")) for record in answers(given)]
    with styled():
        axes = charts.confusion({"one": verdicts}, 3.5).axes[0]
    shares = np.nan_to_num(np.ma.filled(axes.get_images()[0].get_array(), 0))
    assert [label.get_text() for label in axes.get_xticklabels()] == ["book", "cup", "dragon"]
    assert [label.get_text() for label in axes.get_yticklabels()] == ["book", "cup"]
    assert shares.tolist() == [[0, 0, 100], [0, 50, 50]]


@pytest.mark.parametrize("width", WIDTHS_INCH.values())
@pytest.mark.parametrize("panels", [1, 3, 6])
@pytest.mark.filterwarnings("error")  # Matplotlib gives up a layout with no more than a warning
def test_long_names_leave_room_for_the_panels_of_a_confusion(panels: int, width: float) -> None:
    for name in ("red cup on the left", "the third book from the left on the upper shelf"):
        truth = ["cup", "book", name] * 2
        verdicts = [judge(record, "girl", labels(*truth).at(record.frame, "girl")) for record in answers(truth)]
        with styled():
            figure = charts.confusion({f"configuration {number}": verdicts for number in range(panels)}, width)
            saved(figure, "svg")  # lays it out
        across, down = figure.get_size_inches()
        for axes in figure.axes[:panels]:
            assert axes.get_position().height * down > 3 * 0.08
            assert axes.get_position().width * across > 0.8
        tight = figure.get_tightbbox()
        assert tight.y0 >= -0.02
        assert tight.x0 >= -0.02


def test_letters_that_no_font_has_are_named(tmp_path: Path, no_pdf: None, recwarn: pytest.WarningsRecorder) -> None:
    sign = "\N{CUNEIFORM SIGN A}"

    def draw(width: float) -> Figure:
        figure = canvas(width, 1)
        figure.add_subplot().set(xlabel=f"cup {sign}")
        return figure

    figures = Figures(drawn={"frr": draw})
    write_figures(figures, tmp_path)
    assert len(figures.missing) == 1
    assert f"({sign})" in figures.missing[0]
    assert not recwarn.list


def test_settings_of_the_user_do_not_matter() -> None:
    def drawn() -> bytes:
        with styled():
            figure = canvas(2, 1)
            figure.add_subplot().set(xlabel="x")
            return saved(figure, "svg")

    plain = drawn()
    with mpl.rc_context({"font.size": 30, "axes.facecolor": "red", "svg.fonttype": "none"}):
        assert drawn() == plain


def test_the_command_names_what_it_wrote_and_left_out(
    run: Path,
    files: Path,
    tmp_path: Path,
    no_pdf: None,
    monkeypatch: pytest.MonkeyPatch,
    capsys: pytest.CaptureFixture[str],
) -> None:
    out = tmp_path / "new" / "figures"
    code, said, _ = vfoa(monkeypatch, capsys, "figures", str(run), "--out", str(out))
    assert code == 0
    assert said.splitlines()[-1] == f"5 files in {out}: frr, frr_by_clip, error_types, confusion, calibration"
    assert said.startswith("Left out: learning_curve: ")
    assert "--even-if-worse" not in said  # an option of vfoa fit
    assert {path.name for path in out.iterdir()} == {f"{name}_1col.svg" for name in EXPECTED}
    for file in files.glob("*.svg"):
        assert (out / file.name).read_bytes() == file.read_bytes()  # equal runs give equal bytes
    code, _, err = vfoa(monkeypatch, capsys, "figures", str(run), "--out", str(out))
    assert (code, err.splitlines()) == (
        2,
        [f"vfoa: {out / 'frr_1col.svg'}: exists already; expected --replace, or another --out"],
    )


def test_a_run_without_an_error_has_no_chart_of_errors(
    tmp_path: Path, no_pdf: None, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    clip = write_clip(tmp_path, "clip", LABELLED)
    run = write_run(tmp_path / "run", answers(LABELLED, clip="clip"), clips=[clip]).path
    code, said, err = vfoa(monkeypatch, capsys, "figures", str(run), "--out", str(tmp_path / "out"))
    assert (code, err) == (0, "")
    assert "Left out: error_types: no frame is wrong" in said.splitlines()
    assert {path.name for path in (tmp_path / "out").glob("[ef]*")} == {"frr_1col.svg", "frr_by_clip_1col.svg"}


@pytest.fixture
def recorded(tmp_path: Path) -> Path:
    """A finished run of one clip with recordings, in which the subject's cup is always the truth."""
    run = RunDirectory(write_recorded(tmp_path / "run", {"two cones": four_frames()}).run)
    tables = f'[subjects."{ANN}"]\ncategory = "person"\n[targets."red cup"]\ncategory = "cup"\n'
    for folder, file, text in (
        ("datasets", "clip.toml", f'name = "clip"\nadapter = "studio"\nlicence = "MIT"\n{tables}'),
        ("annotations", "clip.csv", labels_text(f"10,14,{ANN},red cup,")),
    ):
        (tmp_path / folder).mkdir()
        (tmp_path / folder / file).write_text(text, encoding="utf-8")
    manifest = run.read_manifest().plain()
    manifest["clips"][0]["manifest"] = str(tmp_path / "datasets" / "clip.toml")
    methods = {"two cones": {"probabilistic": False, "says_nowhere": False}}
    write_manifest(run, {**manifest, "methods": methods, "finished": "now"})
    return run.path


def test_a_failure_is_drawn_with_image_scene_and_curves(
    recorded: Path, tmp_path: Path, no_pdf: None, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    words = ("figures", str(recorded), "--out", str(tmp_path / "out"), "--frame", "14")
    code, said, _ = vfoa(monkeypatch, capsys, *words)
    assert (code, said.splitlines()[-1].rpartition(", ")[2]) == (0, "failure")
    svg = tmp_path / "out" / "failure_1col.svg"
    texts = _texts(svg.read_text(encoding="utf-8"))
    inside = {"left image", "scene in metres", "attention", f"attention of {ANN}", "frame", "truth", "answer"}
    legend = {"red cup", "book#4", "true target", "cones of the gaze", "cones of the head"}
    assert (inside | legend) - texts == set()
    title = " ".join(sorted(texts))
    assert "clip, two cones, frame 14" in title
    assert svg.read_text(encoding="utf-8").count("<image") >= 3  # the left image, the masks, the clouds


def test_a_failure_has_the_present_names_of_targets(recorded: Path, tmp_path: Path) -> None:
    for file in ("datasets/clip.toml", "annotations/clip.csv"):
        text = (tmp_path / file).read_text(encoding="utf-8").replace("red cup", "mug")
        changed = text.replace('[targets."mug"]', '[targets.mug]\nformerly = ["red cup"]')
        (tmp_path / file).write_text(changed, encoding="utf-8")
    with styled():
        figure = figures_of([recorded], Wanted(frame=14)).drawn["failure"](3.5)
        texts = _texts(saved(figure, "svg").decode())
    assert "mug" in texts
    assert "red cup" not in texts


def test_of_two_targets_of_a_name_the_one_at_the_labels_point_is_the_true_one() -> None:
    record = renamed(four_frames()[3].record, {"book#4": "red cup"})
    meant, _, answered = (target.instance_id for target in record.targets if target.name == "red cup")
    label = Label(target="red cup", point_px=(30, 30))
    verdict = judge(record, ANN, label)
    nothing = FrameContent(image=None, masks=None, clouds={}, cones={})
    failure = WrongFrame(
        verdict=verdict, label=label, content=nothing, records=[record], verdicts=[verdict], targets=["red cup"]
    )
    assert failure.marks == {meant: RIGHT, answered: OFF}


def test_the_curves_of_probabilities_include_that_of_looking_at_nothing() -> None:
    record = four_frames()[0].record
    (subject,) = record.subjects
    values = tuple(replace(value, total=0.3 * (value.instance_id == 4)) for value in subject.attention)
    record = replace(record, subjects=(replace(subject, attention=values, focus=None),))
    for probabilistic, expected in ((True, {"book#4": 0.3, "none": 0.7}), (False, {"book#4": 0.3})):
        verdict = judge(record, ANN, Label(target="red cup"), AnswerTraits(probabilistic=probabilistic))
        failure = WrongFrame(
            verdict=verdict,
            label=Label(target="red cup"),
            content=FrameContent(image=None, masks=None, clouds={}, cones={}),
            records=[record],
            verdicts=[verdict],
            targets=["red cup"],
        )
        with styled():
            figure = strip(failure, 3.5)
            curves = figure.axes[-1].get_lines()
        named = {str(each.get_label()): each.get_ydata() for each in curves}
        words = {text.get_text() for text in figure.legends[0].get_texts()}
        assert words == {*expected, "true target", "answer"}  # nothing here has cones
        found = {name: y for name, (y, *_) in named.items() if not name.startswith("_")}
        assert found == pytest.approx(expected)


@pytest.mark.parametrize("width", WIDTHS_INCH.values())
@pytest.mark.parametrize(
    "longest", ["remote control of the television", "the third book from the left on the upper shelf"]
)
def test_the_legend_of_a_failure_is_inside_with_long_names(longest: str, width: float) -> None:
    names = {"red cup": "coffee machine", "book#4": longest}
    record = renamed(four_frames()[3].record, names)
    (subject,) = record.subjects
    values = tuple(replace(value, total=0.3) for value in subject.attention)
    record = replace(record, subjects=(replace(subject, attention=values),))
    label = Label(target="coffee machine")
    verdict = judge(record, ANN, label)
    nothing = FrameContent(image=None, masks=None, clouds={}, cones={})
    failure = WrongFrame(
        verdict=verdict, label=label, content=nothing, records=[record], verdicts=[verdict], targets=["coffee machine"]
    )
    with styled():
        figure = strip(failure, width)
        saved(figure, "svg")  # lays it out
        (legend,) = figure.legends
        extent = legend.get_window_extent()
    assert {*names.values()} <= {text.get_text() for text in legend.get_texts()}
    assert 0 <= extent.x0 < extent.x1 <= figure.bbox.x1
    assert not any(extent.overlaps(axes.get_window_extent()) for axes in figure.axes)


def test_a_failure_that_is_not_there_is_named(
    recorded: Path, tmp_path: Path, no_pdf: None, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    out = str(tmp_path / "out")
    code, said, _ = vfoa(monkeypatch, capsys, "figures", str(recorded), "--out", out, "--frame", "12")
    assert code == 0
    assert "Left out: failure: no such wrong frame has a recording" in said.splitlines()
    assert not list((tmp_path / "out").glob("failure*"))


def test_without_matplotlib_one_line_says_what_to_install(
    monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str], tmp_path: Path
) -> None:
    monkeypatch.setattr("harness.report.figures.files.find_spec", lambda name: None)
    code, out, err = vfoa(monkeypatch, capsys, "figures", str(tmp_path), "--out", str(tmp_path / "out"))
    assert (code, out) == (2, "")
    expected = "vfoa: figures: needs the package matplotlib; expected vfoa installed with its extra: vfoa[figures]\n"
    assert err == expected
