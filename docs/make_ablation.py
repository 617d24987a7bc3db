"""Write the tables of maps.md from what `python benchmarks/ablation.py -o DIR` wrote.

python docs/make_ablation.py DIR/ablation.csv
"""

from __future__ import annotations

import csv
import sys
from pathlib import Path

PAGE = Path(__file__).parent / "maps.md"
START, END = "<!-- ablation, by make_ablation.py -->\n", "<!-- end of the ablation -->\n"
NETWORKS = ("vdsom", "vdsom:border", "vdsom:rho", "som", "gng", "grid", "random", "rows")
HEADER = ("VDSOM", "`border`", "`rho`", "SOM", "GNG", "grid", "random", "rows")
FORWARD = {
    "local": "body and local models",
    "linear": "`linear`, no body",
    "activity": "`activity`",
}
LONG = {
    "noise": "noise of 1 mm",
    "uneven": "uneven log",
    "UR10 A": "UR10 A, held out",
    "UR10 C": "UR10 C, held out",
}
# columns beside the forward errors: which cases show them, and whether less is better
OTHERS = (
    ("local inverse", "inverse, body and local models [deg]", ("ripple", "UR10 A"), True),
    ("linear inverse", "inverse, `linear` [deg]", ("exact", "uneven"), True),
    ("missed", "branches missed [%]", ("exact", "uneven"), True),
    ("local covered", "covered by the 95 % bound, body [%]", ("UR10 A", "UR10 C"), None),
    ("linear covered", "covered, `linear` [%]", ("uneven", "UR10 A", "UR10 C"), None),
    ("seconds", "training [s]", ("exact",), None),
)


def main() -> None:
    """Replace the tables between the two markers."""
    with Path(sys.argv[1]).open() as file:
        rows = list(csv.DictReader(file))
    found = {(r["nodes"], r["case"], r["network"]): r for r in rows}
    cases = list(dict.fromkeys(r["case"] for r in rows))
    text = ""
    for nodes in dict.fromkeys(r["nodes"] for r in rows):
        text += f"**{nodes} nodes**\n\n| case | readout | " + " | ".join(HEADER) + " |\n"
        text += "|---|---|" + "---|" * len(HEADER) + "\n"
        for case in cases:
            mine = [found.get((nodes, case, network)) for network in NETWORKS]
            text += "".join(lines(case, mine))
        text += "\n"
    page = PAGE.read_text()
    before, rest = page.split(START)
    PAGE.write_text(before + START + "\n" + text + END + rest.split(END)[1])


def lines(case: str, mine: list[dict[str, str] | None]) -> list[str]:
    """The table's lines of one case at one size: a cell for each network."""
    name = LONG.get(case, case)
    shown = []
    for readout, label in FORWARD.items():
        for part in ("defect", "elsewhere"):
            cells = [r and r.get(f"{readout} {part}") for r in mine]
            if any(cells):
                where = {"defect": ", in the defect", "elsewhere": ", elsewhere"}[part]
                has = any(r and r.get("local defect") for r in mine)
                shown.append((f"{name}{where if has else ''}", label, cells, True))
    for column, label, wanted, best in OTHERS:
        if case in wanted:
            shown.append((name, label, [r and r.get(column) for r in mine], best))
    return [f"| {a} | {b} | {' | '.join(marked(cells, best))} |\n" for a, b, cells, best in shown]


def marked(cells: list[str | None], best: bool | None) -> list[str]:
    """Numbers of three digits, the best ones bold where they differ."""
    words = ["" if not c else digits(float(c)) for c in cells]
    known = {w: float(w) for w in words if w}
    if best is None or len(known) < 2:
        return words
    least = min(known.values())
    return [f"**{w}**" if w and known[w] == least else w for w in words]


def digits(value: float) -> str:
    """Three digits; nothing below a tenth of a micrometre."""
    if value < 1e-4:
        return "0"
    return f"{value:#.3g}".rstrip(".") if value >= 0.01 else f"{value:.4f}"


if __name__ == "__main__":
    main()
