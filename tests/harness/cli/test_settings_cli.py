"""The settings reference, and what a shell completes."""

from __future__ import annotations

import re
from collections.abc import Iterator
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import pytest
from pydantic import create_model

import vfoa as package
from harness.cli import commands
from harness.cli.options import configuration_names, experiment_and_clip_names, recorded_clip_names
from harness.pipeline.configuration import STEPS, TABLES
from harness.pipeline.settings_reference import setting_keys, settings_tables
from harness.run.experiment import load_experiment
from tests.command import vfoa
from vfoa.errors import VfoaError
from vfoa.settings import Settings


def test_every_setting_has_a_meaning() -> None:
    settings = [setting for table in settings_tables() for setting in table.settings]
    assert [setting.key for setting in settings if not setting.meaning] == []
    assert len(settings) > 100


def test_the_reference_of_a_stage_has_every_key_of_its_choices() -> None:
    keys = {setting.key.partition(".")[2] for table in settings_tables("stereo.sgbm") for setting in table.settings}
    assert {"min_depth_m", "wls_sigma", "p1", "mode"} <= keys
    (sgbm,) = settings_tables("stereo.sgbm")
    by_key = {setting.key: setting for setting in sgbm.settings}
    assert (by_key["stereo.min_depth_m"].type, by_key["stereo.min_depth_m"].unit) == ("number > 0", "m")
    assert by_key["stereo.mode"].default == '"3way"'
    with pytest.raises(VfoaError, match="did you mean 'stereo'"):
        settings_tables("sterio")


def test_the_reference_shows_tables_in_short_and_no_type_of_the_code() -> None:
    (logit,) = settings_tables("attention.logit")
    by_key = {setting.key: (setting.type, setting.default) for setting in logit.settings}
    assert by_key["attention.weights"] == ('table of forward, both or "left-out"', "{ forward = ..., both = ... }")
    assert by_key["attention.by_clip"] == ("table of names, each a table of forward, both", "{}")


def test_settings_whose_source_is_not_there_have_no_meaning(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setitem(STEPS, "tracking", create_model("Compiled", __base__=Settings, rate_hz=(float, 25.0)))
    (table,) = settings_tables("tracking")
    assert [(each.key, each.default, each.meaning) for each in table.settings] == [("tracking.rate_hz", "25", "")]


def test_every_key_of_the_reference_is_one_that_set_takes() -> None:
    for table in settings_tables():
        chosen = [f"{table.table}.{table.choice.replace(' ', '')}"] if table.choice else []
        optional = [setting for setting in table.settings if setting.default not in ("(required)", "(not set)")]
        given = [f"{each.key}={each.default}" for each in optional if "..." not in each.default]
        needed = [f"{setting.key}=x" for setting in table.settings if setting.default == "(required)"]
        (configuration,) = load_experiment(
            "default", clips=("studio_table",), overrides=(*chosen, *given, *needed)
        ).configurations
        assert configuration.plain()


def test_the_command_prints_every_key_of_a_stage(
    monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.setenv("COLUMNS", "200")
    _, printed, _ = vfoa(monkeypatch, capsys, "settings", "stereo")
    for table in settings_tables("stereo"):
        assert all(setting.key in printed for setting in table.settings)


@pytest.mark.parametrize("words", [("-h",), ("run", "-h"), ("clips", "list", "-h")])
def test_h_is_help(words: tuple[str, ...], monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]) -> None:
    code, printed, _ = vfoa(monkeypatch, capsys, *words)
    assert (code, "Usage: vfoa" in printed) == (0, True)


def test_the_version_is_printed(monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]) -> None:
    assert vfoa(monkeypatch, capsys, "--version") == (0, f"vfoa {package.__version__}\n", "")


@pytest.mark.parametrize(
    ("line", "offered"),
    [
        ("vfoa run dem", "demo"),
        ("vfoa annotate studio_t", "studio_table"),
        ("vfoa run demo --set stereo.matc", "stereo.matcher="),
        ("vfoa settings stereo.sg", "stereo.sgbm"),
        ("vfoa bench dem", "demo"),
        ("vfoa labels import looks.csv --clip studio_t", "studio_table"),
        ("vfoa models fetch yun", "yunet"),
        ("vfoa fit demo --config b", "bm-two"),
        ("vfoa bench --only att", "attention"),
        ("vfoa labels import looks.csv --format el", "elan"),
        ("vfoa labels import looks.csv --format b", "boris"),
        ("vfoa labels export studio_talk --format el", "elan"),
        ("vfoa labels export studio_talk --format b", ""),
    ],
)
def test_a_shell_completes_a_line(
    line: str, offered: str, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    """Of formats that are only read, none is offered to be written."""
    monkeypatch.setenv("_VFOA_COMPLETE", "complete_bash")
    monkeypatch.setenv("COMP_WORDS", line)
    monkeypatch.setenv("COMP_CWORD", str(len(line.split()) - 1))
    _, printed, _ = vfoa(monkeypatch, capsys)
    assert offered in printed.split() if offered else not printed.strip()


def _parameters(command: Any, name: str = "vfoa") -> Iterator[tuple[str, Any]]:
    """Every parameter of a command and of those in it, with the words that call it."""
    for parameter in command.params:
        yield f"{name} {parameter.name}", parameter
    for word, each in getattr(command, "commands", {}).items():
        yield from _parameters(each, f"{name} {word}")


def test_a_shell_completes_every_name_that_vfoa_knows() -> None:
    """x."""
    known = {"CLIP", "RUN", "EXPERIMENT", "CONFIGURATION", "MODEL", "FORMAT", "SECTION"}
    named = {
        words: parameter
        for words, parameter in _parameters(commands())
        if known & set(re.split(r"[^A-Z]+", parameter.metavar or ""))
    }
    assert {"vfoa run what", "vfoa compare runs", "vfoa labels import clip", "vfoa bench experiment"} <= named.keys()
    assert [words for words, parameter in named.items() if parameter._custom_shell_complete is None] == []


def test_configurations_and_clips_are_those_of_the_named_run(tmp_path: Path) -> None:
    context = SimpleNamespace(params={"run": tmp_path}, args=[])
    assert configuration_names(context, "") == recorded_clip_names(context, "") == []
    clips = '[{"name": "talk", "frames": [1]}, {"name": "table", "frames": [1]}]'
    manifest = f'{{"configurations": {{"bm": {{}}, "sgbm": {{}}}}, "clips": {clips}}}'
    (tmp_path / "manifest.json").write_text(manifest, encoding="utf-8")
    assert configuration_names(context, "s") == ["sgbm"]
    assert recorded_clip_names(context, "t") == ["table", "talk"]


def test_completion_offers_every_name() -> None:
    assert set(TABLES) <= {key.partition(".")[0] for key in setting_keys()}
    assert {"demo", "studio_table"} <= set(experiment_and_clip_names(""))
