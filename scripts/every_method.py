"""One table of every method on four kinds of material, from the committed reports: written to reports/methods.md.

python -m scripts.every_method, after one of the reports was made anew.
"""

from __future__ import annotations

from scripts.quoted_figures import ROOT, tables

REPORTS = {
    "people.md": "people among ten things (eight, each left out)",
    "conversation.md": "a conversation (one clip)",
    "bandage_2.md": "a drawn film (one clip)",
    "drawn.md": "drawn scenes (24 clips)",
}
COLUMNS = ("n", "FRR %", "95 %", "Balanced %", "Targets %", "Nowhere %", "Log loss", "ECE")
INTRODUCTION = """# Every method on four kinds of material

Written by `python -m scripts.every_method` from reports/people.md, conversation.md, bandage_2.md and drawn.md, which
say what each row is, on which labels it was fitted, and whether the best simple rule is beaten. Of people who look at
nothing most of the time, always answering none gets the FRR of the share of nothing: read the balanced FRR, the mean
of the shares of right answers where there is a target and where there is none. ECE: expected calibration error.
"""


def main() -> None:
    """Write the table."""
    lines = [INTRODUCTION, f"| Material | Configuration | {' | '.join(COLUMNS)} |"]
    lines.append("| --- | --- |" + " ---: |" * len(COLUMNS))
    for report, material in REPORTS.items():
        found = tables(ROOT / "reports" / report)
        rates = next(each for each in found if each.header[0] == "Clip" and "FRR %" in each.header)
        calibration = next((each for each in found if "ECE" in each.header and "Subject" not in each.header), None)
        errors = {row[0]: row[calibration.header.index("ECE")] for row in calibration.rows} if calibration else {}
        several = any(row[0] == "(all)" for row in rates.rows)
        for row in rates.rows:
            if row[0] == "(all)" or not several:
                cells = dict(zip(rates.header, row, strict=True)) | {"ECE": errors.get(row[1], "–")}
                lines.append(f"| {material} | {row[1]} | {' | '.join(cells[name] for name in COLUMNS)} |")
    (ROOT / "reports" / "methods.md").write_text("\n".join(lines) + "\n", encoding="utf-8")


if __name__ == "__main__":
    main()
