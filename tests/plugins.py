"""A package of somebody else's with a stage of its own, as if it were installed."""

from __future__ import annotations

from pathlib import Path

from tests.disk import write_text


def install(site: Path, module: str, source: str, *, group: str, name: str, cls: str) -> Path:
    """Write the package's only module and what an installer writes beside it; return the folder, to put on the path."""
    info = site / f"{module}-1.0.dist-info"
    write_text(site / f"{module}.py", source)
    write_text(info / "METADATA", f"Metadata-Version: 2.1\nName: {module.replace('_', '-')}\nVersion: 1.0\n")
    write_text(info / "entry_points.txt", f"[{group}]\n{name} = {module}:{cls}\n")
    return site
