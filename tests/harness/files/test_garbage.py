from __future__ import annotations

import gc
from contextlib import suppress

from harness.files.garbage import collected_later


def test_nothing_is_collected_within_and_all_goes_on_after_an_error() -> None:
    assert gc.isenabled()
    with suppress(ValueError), collected_later():
        with collected_later():
            assert not gc.isenabled()
        assert not gc.isenabled()  # the outer block goes on
        raise ValueError
    assert gc.isenabled()


def test_who_has_switched_it_off_keeps_it_off() -> None:
    gc.disable()
    try:
        with collected_later():
            pass
        assert not gc.isenabled()
    finally:
        gc.enable()
