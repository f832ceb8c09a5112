"""Rerun's viewer program: its location, and how it is started without any network requests.

By default it sends usage statistics and looks up the newest version; there is no option against either.
"""

from __future__ import annotations

import json
import os
import subprocess
import tempfile
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from pathlib import Path
from typing import IO

import rerun_cli

_NOWHERE = "http://127.0.0.1:9"
"""A proxy that does not answer, so that network requests fail at once."""


def viewer_binary() -> Path:
    """The viewer inside the Rerun package. Ending the ``rerun`` command, a wrapper, would leave the viewer running."""
    return Path(rerun_cli.__file__).with_name("rerun")


@contextmanager
def started(arguments: Sequence[str], said: IO[bytes] | int = subprocess.DEVNULL) -> Iterator[subprocess.Popen[bytes]]:
    """Run the program with these arguments until the block ends, for whatever reason; ``said`` receives its stderr."""
    with tempfile.TemporaryDirectory(prefix="vfoa-") as folder:
        analytics = Path(folder) / "rerun" / "analytics.json"
        analytics.parent.mkdir()
        off = {"analytics_enabled": False, "analytics_id": "", "metadata": {}}
        paths = {"config_file_path": str(analytics), "data_dir_path": str(analytics.parent)}
        analytics.write_text(json.dumps(off | paths), encoding="utf-8")
        inherited = {name: value for name, value in os.environ.items() if name.lower() != "no_proxy"}
        proxies = ("all_proxy", "http_proxy", "https_proxy")
        nowhere = dict.fromkeys([*proxies, *map(str.upper, proxies)], _NOWHERE)
        environment = inherited | nowhere | {"XDG_CONFIG_HOME": folder}
        command = [str(viewer_binary()), *arguments]
        process = subprocess.Popen(command, env=environment, stdout=subprocess.DEVNULL, stderr=said)
        try:
            yield process
        finally:
            process.kill()  # it has nothing to save
            process.wait()
