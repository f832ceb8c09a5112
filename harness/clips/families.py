"""The files of clips' manifests by name, and families: files that make several clips.

A file with a table ``clips`` is a family: it makes a clip of each key, whose values replace ``${KEY}`` in the rest of
the file. ``${CLIP}`` is the clip's name. A family's name means those of its clips whose files are here::

    # datasets/talks.toml
    adapter = "measured"
    root = "${VFOA_DATA}/talks/${CLIP}"
    subjects = { "${PERSON}" = { category = "person" } }
    [clips]
    talk_1 = { PERSON = "anna" }
    talk_2 = { PERSON = "ben" }         # or a table [clips.talk_2]

A variable without a value is refused; in ``root`` it may be one of the environment.
"""

from __future__ import annotations

import fnmatch
import os
import re
from collections.abc import Iterator, Mapping, Sequence
from contextlib import suppress
from pathlib import Path
from typing import Any

from harness.files.ascending import natural_order
from harness.files.digests import settled_stamp
from harness.files.folders import folders, names
from harness.files.groups import grouped
from harness.files.io import read_text
from harness.files.parsing import parse_toml
from harness.files.remote import VARIABLE
from harness.files.safe_names import vfoa_command
from vfoa.errors import VfoaError, did_you_mean, listed


def find_manifest(name: str) -> Path:
    """The manifest's file of a clip.

    Raises
    ------
    VfoaError
        If no clip has this name, or several families have it.
    """
    own = names("datasets").get(name)
    if own and not clips_of(own):  # most are found without a look at all other files
        return own
    files = clip_files()
    if path := files.get(name):
        having = sorted(file for file in path.parent.glob("*.toml") if name in clips_of(file))
        if len(having) > 1:
            raise VfoaError(f"{having[0]}: clips.{name}: {having[1].name} has it, too; expected it in one family")
        return path
    if clips := families().get(name):
        raise VfoaError(f"{name}: a family; expected one of its clips: {listed(clips)}")
    raise unknown_name(name, "clip", f"{did_you_mean(name, files)} (in {folders('datasets')[0]} or built in)")


def unknown_name(name: str, kind: str, expected: str) -> VfoaError:
    """The error of a name of nothing of this kind; where it is that of a recording, with the command that adds it."""
    path = Path(name)
    if name and path.exists() and path.suffix != ".toml" and not (path / "manifest.json").exists():  # which a run has
        found = "folder" if path.is_dir() else "file"
        command = vfoa_command("clips", "add", name)
        return VfoaError(f"{name}: a {found}, and no {kind}; expected the name of one: {command} makes one of it")
    return VfoaError(f"no {kind} {name!r}; {expected}")


def clip_files() -> dict[str, Path]:
    """The manifest's file of every clip by name, sorted; a file of its own comes before a family.

    One's own families come before those that came with the program.
    """
    files, own = names("datasets"), folders("datasets")[0]
    members = {name: clips_of(path) for name, path in files.items()}
    own_last = sorted(members, key=lambda family: files[family].parent == own)  # the last one counts
    of_families = {clip: files[family] for family in own_last for clip in members[family]}
    return dict(sorted({**of_families, **{name: path for name, path in files.items() if not members[name]}}.items()))


def matching(pattern: str) -> list[str]:
    """The clips whose names match a pattern of ``*`` and ``?``, ``p2`` before ``p10``: one's own, or built-in ones.

    Raises
    ------
    VfoaError
        If no clip matches.
    """
    files = clip_files()
    found = sorted(fnmatch.filter(files, pattern), key=natural_order)
    own = [name for name in found if files[name].is_relative_to(folders("datasets")[0])]
    if not found:
        raise VfoaError(f"no clip matches {pattern!r}; {did_you_mean(pattern, files)}")
    return own or found


def patterns_of(clips: Sequence[str]) -> list[str]:
    """The fewest beginnings with ``*`` that :func:`matching` reads as these clips alone, and names that have none."""
    first, last = min(clips), max(clips)
    beginning = first[
        : next((k for k, (one, other) in enumerate(zip(first, last, strict=False)) if one != other), None)
    ]
    if len(clips) == 1 or (beginning and {*matching(f"{beginning}*")} == {*clips}):
        return [clips[0] if len(clips) == 1 else f"{beginning}*"]
    groups = grouped((name[: len(beginning) + 1], name) for name in clips)
    return [pattern for group in groups.values() for pattern in patterns_of(group)]


def is_pattern(name: str) -> bool:
    """Whether it is one for :func:`matching`: no clip's name has these characters."""
    return "*" in name or "?" in name


def families() -> dict[str, tuple[str, ...]]:
    """The clips of each family by its name."""
    return {name: clips for name, path in names("datasets").items() if (clips := clips_of(path))}


def family_of(name_or_path: str) -> str:
    """The name of a family of which this is the file, or the same text."""
    path = Path(name_or_path)
    own = names("datasets").get(path.stem) if path.suffix == ".toml" else None
    return path.stem if own and path.is_file() and path.samefile(own) and clips_of(own) else name_or_path


_CLIPS = re.compile(r"""^\s*(\[\s*)?["']?clips\b""", re.MULTILINE)
"""A line of a file that may have the table: most have none, and are read faster."""


def clips_of(path: Path) -> tuple[str, ...]:
    """The clips of a family; none for the manifest of one clip, and for a file that cannot be read.

    Every search for a clip asks all files, so what was found is kept by the file's stamp.
    """
    stamp = settled_stamp([("clips", os.fspath(path))])
    if stamp in _KNOWN:
        return _KNOWN[stamp]
    clips: tuple[str, ...] = ()
    with suppress(VfoaError):
        text = read_text(path)
        found = parse_toml(text, "").get("clips") if _CLIPS.search(text) else None
        clips = tuple(found) if isinstance(found, dict) else ()
    if stamp is not None:
        _KNOWN[stamp] = clips
    return clips


_KNOWN: dict[str | None, tuple[str, ...]] = {}
"""The clips of a family by the stamp of its file (:mod:`harness.files.digests`)."""


def member_of(data: dict[str, Any], path: Path, clip: str | None) -> dict[str, Any]:
    """The content of a family's file for one clip: its name, and the rest of the file with its values filled in.

    Raises
    ------
    VfoaError
        If the family does not have the clip, or a variable has no value.
    """
    clips = data["clips"]
    if not isinstance(clips, dict) or not all(map(_is_values, clips.values())):
        raise VfoaError(f"{path}: clips: expected a table of values for each clip")
    if clip not in clips:
        hint = f"expected one of its clips by name: {listed([*clips])}" if clip is None else did_you_mean(clip, clips)
        raise VfoaError(f"{path}: {'a family' if clip is None else f'no clip {clip!r}'}; {hint}")
    values = {"CLIP": clip, **clips[clip]}
    of_others = {name for other in clips.values() for name in other}
    for key, value in data.items():
        for name in _variables(value) if key != "clips" else ():
            if name not in values and (name in of_others or key not in _WITH_ENVIRONMENT):
                given = ", ".join(clips[clip]) or "none"
                raise VfoaError(
                    f"{path}: clips.{clip}: {name}: missing, and ${{{name}}} stands in {key}; expected a value of it "
                    f"(found: {given})"
                )
    filled = {key: _filled(value, values) for key, value in data.items() if key != "clips"}
    return {"name": clip, **filled}


_WITH_ENVIRONMENT = ("root", "labels_file")
"""Keys whose other variables are those of the environment."""


def _is_values(of_clip: Any) -> bool:
    return isinstance(of_clip, dict) and all(isinstance(value, str | int | float) for value in of_clip.values())


def _variables(value: Any) -> Iterator[str]:
    """The variables everywhere in a value."""
    if isinstance(value, str):
        yield from VARIABLE.findall(value)
    for item in (*value, *value.values()) if isinstance(value, dict) else value if isinstance(value, list) else ():
        yield from _variables(item)


def _filled(value: Any, values: Mapping[str, Any]) -> Any:
    """A value with the variables filled in everywhere; other variables are those of the environment, and stay."""
    if isinstance(value, str):
        return VARIABLE.sub(lambda match: str(values.get(match[1], match[0])), value)
    if isinstance(value, dict):
        return {_filled(key, values): _filled(item, values) for key, item in value.items()}
    return [_filled(item, values) for item in value] if isinstance(value, list) else value
