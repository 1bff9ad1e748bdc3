"""A Markdown table of the scores of several engines: a row for each case, numbered causes below.

python tools/engines/conformance_table.py SCORED/conformance.json ...
"""

from __future__ import annotations

import json
import sys
from pathlib import Path


def cell(case: dict, causes: dict[str, int]) -> str:
    """``right``, the number of the reason why a case is not judged, or each wrong class with its share and cause."""
    if case["status"] == "not judged":
        return f"– {causes.setdefault(case['reason'].removeprefix('scene not loaded as written: '), len(causes) + 1)}"
    wrong: dict[int, list[dict]] = {}
    for each in case["classes"]:
        if each["cause"]:
            wrong.setdefault(causes.setdefault(each["cause"], len(causes) + 1), []).append(each)
    parts = []
    for number, classes in sorted(wrong.items()):
        share = max(each["wrong_percent"] for each in classes)
        most = max((each["max_px"] for each in classes if each["max_px"] is not None), default=0.0)
        length = f", {most:.{0 if most >= 9.5 else 2}f} px" if most >= 0.01 else ", below 0.01 px" * (most > 0.0)
        percent = f"{share:.0f}" if share >= 9.5 else f"{share:.1f}"
        parts.append(f"{', '.join(each['name'] for each in classes)}: {percent} %{length} ({number})")
    return "; ".join(parts) or "right"


def main(paths: list[str]) -> None:
    """Print the table of score files."""
    scores = [json.loads(Path(path).read_text(encoding="utf-8")) for path in paths]
    causes: dict[str, int] = {}
    names = [case["name"] for case in scores[0]["cases"]]
    print("| case | " + " | ".join(score["engine"] for score in scores) + " |")
    print("|---" * (len(scores) + 1) + "|")
    for row, name in enumerate(names):
        print(f"| {name} | " + " | ".join(cell(score["cases"][row], causes) for score in scores) + " |")
    totals = [f"{s['right']} right, {s['wrong']} wrong, {s['not_judged']} not judged" for s in scores]
    print("| **all** | " + " | ".join(totals) + " |\n")
    for text, number in causes.items():
        print(f"{number}. {text}")


if __name__ == "__main__":
    main(sys.argv[1:])
