"""``python -m scripts.measure``: every name is a measurement, and another one is refused."""

from __future__ import annotations

from importlib import import_module

import pytest

from scripts.measure.__main__ import NAMES, main


@pytest.mark.parametrize("name", NAMES)
def test_every_measurement_has_a_command_line(
    name: str, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.setattr("sys.argv", ["measure", name, "--help"])
    with pytest.raises(SystemExit) as ended:
        main()
    assert ended.value.code == 0
    assert f"scripts.measure {name}" in capsys.readouterr().out
    assert callable(import_module(f"scripts.measure.{name}").main)


def test_another_name_is_one_line(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("sys.argv", ["measure", "hour"])
    with pytest.raises(SystemExit, match=r"no 'hour'.*hours"):
        main()
