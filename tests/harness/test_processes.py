"""Ctrl-C while the command is still imported, and where an exception would be lost; packages that are not there."""

from __future__ import annotations

import os
import signal
import subprocess
import sys
from pathlib import Path

import pytest

from harness.__main__ import main
from tests.disk import write_text
from tests.repository import REPOSITORY

INTERRUPTED = """\
import os, signal, sys

class Interrupt:
    def find_spec(self, name, path=None, target=None):
        if name == {name!r}:
            sys.meta_path.remove(self)
            os.kill(os.getpid(), signal.SIGINT)

sys.meta_path.insert(0, Interrupt())
"""


@pytest.mark.parametrize(
    "start", ["from harness.__main__ import main; main()", "import harness; harness.load_run('runs')"]
)
def test_windows_is_told_what_to_install(start: str) -> None:
    """Not that a package is missing: it has no module ``fcntl``."""
    code = f"import sys; sys.platform = 'win32'; sys.argv = ['vfoa', 'run', 'demo']; {start}"
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=False, cwd=REPOSITORY)
    assert done.returncode == 1
    assert "WSL" in done.stderr.splitlines()[-1]


@pytest.mark.parametrize("name", ["harness.processes", "typing", "harness.cli", "typer"])
def test_ctrl_c_while_a_module_is_imported_says_nothing(tmp_path: Path, name: str) -> None:
    """Interrupt a Python that has imported only what every start imports (``-S``), at the import of a module."""
    paths = [str(REPOSITORY), *(path for path in sys.path if path)]
    code = f"import sys; sys.path[:0] = {paths!r}\n{INTERRUPTED.format(name=name)}"
    code += "from harness.__main__ import main\nsys.argv = ['vfoa', '--version']\nmain()\n"
    script = write_text(tmp_path / "start.py", code)
    done = subprocess.run(
        [sys.executable, "-S", script],
        capture_output=True,
        text=True,
        check=False,
        preexec_fn=lambda: signal.signal(signal.SIGINT, signal.SIG_DFL),
    )
    assert (done.stdout, done.stderr) == ("", "")
    assert done.returncode in (130, -signal.SIGINT)


LIBRARY = """\
import os, signal
try:
    os.kill(os.getpid(), signal.SIGINT)
except BaseException:
    pass
print("went on")
"""

LOST = {
    "__del__": """\
class Resource:
    def __del__(self):
        os.kill(os.getpid(), signal.SIGINT)
        print("went on")

Resource()
""",
    "weak reference": """\
class Resource:
    def close(self):
        pass

def forget(reference):
    os.kill(os.getpid(), signal.SIGINT)
    print("went on")

resource = Resource()
reference = weakref.WeakMethod(resource.close, forget)
del resource
""",
    "import": "import interrupted",
    "blocked": """\
def send():
    blocked.wait()
    os.kill(os.getpid(), signal.SIGINT)

blocked = threading.Event()
threading.Thread(target=send, daemon=True).start()
try:
    signal.pthread_sigmask(signal.SIG_BLOCK, [signal.SIGINT])
    blocked.set()
    time.sleep(0.2)
    print("went on")
except KeyboardInterrupt:
    print("while it was blocked")
signal.pthread_sigmask(signal.SIG_UNBLOCK, [signal.SIGINT])
""",
}
"""Statements that end, although a signal comes; Python drops a KeyboardInterrupt there, or it would do harm."""


def _run_script(script: Path) -> subprocess.CompletedProcess[str]:
    """A script that imports from this repository and from its own folder."""
    return subprocess.run(
        [sys.executable, script],
        capture_output=True,
        text=True,
        check=False,
        env={**os.environ, "PYTHONPATH": f"{REPOSITORY}{os.pathsep}{script.parent}"},
        timeout=30,
    )


@pytest.mark.skipif(sys.platform == "win32", reason="Windows has no such signals")
@pytest.mark.parametrize("statement", LOST)
def test_ctrl_c_is_neither_lost_nor_too_early(tmp_path: Path, statement: str) -> None:
    write_text(tmp_path / "interrupted.py", LIBRARY)
    write_text(
        tmp_path / "start.py",
        "import os, signal, threading, time, weakref\nfrom harness.processes import interrupt\n"
        f"signal.signal(signal.SIGINT, interrupt)\n{LOST[statement]}\ntime.sleep(60)\n",
    )
    done = _run_script(tmp_path / "start.py")
    assert (done.stdout, done.returncode) == ("went on\n", -signal.SIGINT), done.stderr
    assert done.stderr.rstrip().endswith("KeyboardInterrupt")


@pytest.mark.skipif(sys.platform == "win32", reason="Windows has no such signals")
def test_ctrl_c_at_the_very_end_does_not_fail_what_is_done(tmp_path: Path) -> None:
    """The signal comes where it must wait, and the interpreter has ended its handlers before the wait is over."""
    write_text(
        tmp_path / "end.py",
        "import os, signal, time\nfrom harness.processes import interrupt\n"
        "signal.signal(signal.SIGINT, interrupt)\n"
        "class Slow:\n    def __del__(self, sleep=time.sleep):\n        sleep(0.2)\nslow = Slow()\n"
        f"{LOST['__del__']}",
    )
    done = _run_script(tmp_path / "end.py")
    assert (done.stdout, done.stderr, done.returncode) == ("went on\n", "", 0)


@pytest.mark.parametrize(("importer", "is_ours"), [("harness.cli.run", True), ("their_plugin.method", False)])
def test_a_missing_package_is_the_extra_s_only_where_this_program_imports_it(
    importer: str, is_ours: bool, monkeypatch: pytest.MonkeyPatch
) -> None:
    """A plug-in that lacks a package of its own is not told to install the harness."""
    monkeypatch.setattr("signal.signal", lambda number, handler: None)  # those of the tests' own process stay
    monkeypatch.setattr("harness.cli.main", lambda: exec("import absent_package", {"__name__": importer}))
    with pytest.raises(SystemExit if is_ours else ModuleNotFoundError, match="absent_package") as ended:
        main()
    assert ("vfoa[harness]" in str(ended.value)) == is_ours


def test_a_run_and_a_rendered_clip_import_nothing_heavy_that_they_do_not_use() -> None:
    code = "import sys, harness.run.runner, harness.report.sinks; print(*sys.modules)\n"
    code += "import harness.studio.raycast; print(*sys.modules); print(sys.modules['open3d'].__version__)"
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True, cwd=REPOSITORY)
    *modules, open3d = done.stdout.splitlines()
    of_run, of_clip = (set(line.split()) for line in modules)
    assert not {"scipy.spatial", "open3d", "onnxruntime", "rerun", "pandas"} & of_run
    assert "open3d" in of_clip
    assert not {"dash", "plotly", "matplotlib"} & of_clip
    assert ("pandas" in of_clip) == open3d.startswith("0.19.")  # which imports it itself


def test_the_code_of_all_stages_imports_neither_onnx_runtime_nor_scipy() -> None:
    """Settings, and a run whose outputs are in the cache, need the classes of stages, but run no network."""
    code = "import sys; from harness.pipeline.settings_reference import settings_tables\n"
    code += "settings_tables(); print(*sys.modules)"
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True, cwd=REPOSITORY)
    modules = set(done.stdout.split())
    assert "vfoa.segmentation.mask_classification" in modules
    assert not {"onnxruntime", "scipy"} & modules
