"""Print the calls from ``run_clip`` to the matcher's ``match`` during ``vfoa run demo --limit 2``.

    python -m tests.calls

Each line is a function that the one before it calls. The run has one process, one thread and no cache.
"""

from __future__ import annotations

import sys
import tempfile
from pathlib import Path
from types import FrameType
from unittest.mock import patch

from harness.run.experiment import load_experiment
from harness.run.loop import run_clip
from harness.run.runner import prepare, run_plan
from vfoa.stereo.block_matching import BlockMatcher


def calls_to_match() -> list[str]:
    """The functions between ``run_clip`` and the first call of ``match``, this one included, as module.function."""
    found: list[str] = []
    match = BlockMatcher.match

    def noted(self: BlockMatcher, frame: object) -> object:
        caller: FrameType | None = sys._getframe()
        path: list[str] = []
        while caller is not None and caller.f_code is not run_clip.__code__:
            path.append(f"{caller.f_globals['__name__']}.{caller.f_code.co_qualname}")
            caller = caller.f_back
        found[:] = found or [f"{BlockMatcher.__module__}.{match.__qualname__}", *path[1:]][::-1]
        return match(self, frame)  # type: ignore[arg-type]

    with tempfile.TemporaryDirectory() as folder, patch.object(BlockMatcher, "match", noted):
        plan = prepare(load_experiment("demo", clips=("studio_table",)), limit=2)
        run_plan(plan, Path(folder) / "run", workers=1, progress=lambda clip: None)
    return found


def main() -> None:
    """Print the calls and their number."""
    calls = calls_to_match()
    print(f"{run_clip.__module__}.{run_clip.__qualname__}")  # noqa: T201
    for call in calls:
        print(call)  # noqa: T201
    print(f"{len(calls)} calls")  # noqa: T201


if __name__ == "__main__":
    main()
