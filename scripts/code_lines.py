"""Lines of code by room: ``python -m scripts.code_lines``. Blanks, docstrings, comments and imports are not counted."""

from __future__ import annotations

import ast
import io
import tokenize
from collections import Counter
from pathlib import Path

ROOTS = ("harness", "vfoa")
APART = ("studio", "bench")
"""Rooms of the harness that are not in its sum."""

_NO_CODE = {
    *(tokenize.COMMENT, tokenize.NL, tokenize.NEWLINE, tokenize.INDENT, tokenize.DEDENT),
    *(tokenize.ENCODING, tokenize.ENDMARKER),
}


def code_lines(source: str) -> int:
    """Number of lines of a module that hold code."""
    left_out = set[int]()
    for node in ast.walk(ast.parse(source)):
        is_text = (
            isinstance(node, ast.Expr) and isinstance(node.value, ast.Constant) and isinstance(node.value.value, str)
        )
        if is_text or isinstance(node, ast.Import | ast.ImportFrom):
            assert isinstance(node, ast.stmt)
            left_out.update(range(node.lineno, (node.end_lineno or node.lineno) + 1))
    code = set[int]()
    for token in tokenize.generate_tokens(io.StringIO(source).readline):
        if token.type not in _NO_CODE:
            code.update(range(token.start[0], token.end[0] + 1))
    return len(code - left_out)


def main() -> None:
    """Print lines and files of each root, then of its rooms, the largest first."""
    for root in ROOTS:
        lines, files = Counter[str](), Counter[str]()
        for path in sorted(Path(root).rglob("*.py")):
            inside = path.relative_to(root)
            room = inside.parts[0] if len(inside.parts) > 1 else "(loose)"
            lines[room] += code_lines(path.read_text(encoding="utf-8"))
            files[room] += 1
        counted = [room for room in lines if room not in APART]
        apart = "" if len(counted) == len(lines) else f" without {' and '.join(APART)}"
        total = sum(lines[room] for room in counted), sum(files[room] for room in counted)
        table = [f"  {room:16}{count:6}{files[room]:5}" for room, count in lines.most_common()]
        print("\n".join([f"{root}{apart}: {total[0]} lines, {total[1]} files", *table]))  # noqa: T201


if __name__ == "__main__":
    main()
