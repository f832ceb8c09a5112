from __future__ import annotations

from pathlib import Path

import pytest

from harness.pipeline.configuration import STAGES
from vfoa.errors import VfoaError
from vfoa.registry import Registry


def test_an_unknown_name_proposes_the_nearest() -> None:
    registry = Registry(kind="stereo.matcher", builtin={"sgbm": "nowhere:A", "bm": "nowhere:B"}, group="vfoa.none")
    with pytest.raises(VfoaError, match=r"stereo\.matcher: .*'sgmb'.*'sgbm'.*bm"):
        registry.load("sgmb")


def test_auto_is_what_the_registry_chooses_or_a_name_like_any_other() -> None:
    plain = Registry(kind="any", builtin={"one": "nowhere:A"}, group="vfoa.none")
    choosing = Registry(kind="any", builtin={"one": "nowhere:A"}, group="vfoa.none", choose=lambda: "one")
    assert [registry.resolve("auto") for registry in (plain, choosing)] == ["auto", "one"]
    assert choosing.resolve("two") == "two"


def test_nothing_is_imported_before_load() -> None:
    registry = Registry(kind="any", builtin={"absent": "no_such_module:Thing"}, group="vfoa.none")
    assert registry.names() == ["absent"]
    with pytest.raises(ModuleNotFoundError):
        registry.load("absent")


@pytest.mark.parametrize("slot", STAGES.values(), ids=lambda slot: slot.name)
def test_every_builtin_stage_can_be_loaded_and_has_settings(slot: object) -> None:
    for name in slot.names():  # type: ignore[attr-defined]
        if name != "none":
            assert slot.stage_class(name).Settings.model_config["extra"] == "forbid"  # type: ignore[attr-defined]


def test_another_distribution_adds_a_name_by_entry_point(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    (tmp_path / "their_stereo.py").write_text("class Matcher: pass\n")
    info = tmp_path / "their_stereo-1.0.dist-info"
    info.mkdir()
    (info / "METADATA").write_text("Metadata-Version: 2.1\nName: their-stereo\nVersion: 1.0\n")
    (info / "entry_points.txt").write_text("[vfoa.stereo]\ntheirs = their_stereo:Matcher\n")
    monkeypatch.syspath_prepend(tmp_path)

    registry = Registry(kind="stereo.matcher", builtin={}, group="vfoa.stereo")

    assert "theirs" in registry.names()
    assert registry.load("theirs").__module__ == "their_stereo"
