"""Rewrites the documentation's page of figures from JSON that benchmarks wrote: `make figures`.

`personal-viz bench WHAT --json docs/figures/WHAT.json` measures. The page has a place for each file, between the lines
`<!-- figures: WHAT -->` and `<!-- end -->`; everything else in it stays as it is.
"""

import json
import re
import sys
from pathlib import Path

from human_study.export.text_tables import markdown_table

from .harness import Figure, Machine, machine_line, number

_PLACE = re.compile(r"(<!-- figures: ([\w-]+) -->\n).*?(<!-- end -->)", re.DOTALL)


def rewritten(page: str, folder: Path) -> str:
    """The page with the figures of all files in a folder.

    Args:
        page: Markdown.
        folder: Folder of `WHAT.json`; a place without a file stays as it is.
    """

    def block(found: re.Match[str]) -> str:
        path = folder / f"{found[2]}.json"
        return f"{found[1]}{section(path)}{found[3]}" if path.is_file() else found[0]

    return _PLACE.sub(block, page)


def section(path: Path) -> str:
    """The page's lines about one benchmark: when, where, and each figure that has a target or a reference."""
    document = json.loads(path.read_text())
    figures = [Figure.model_validate(row) for row in document["figures"]]
    shown = [one for one in figures if one.value is not None and (one.target or one.reference is not None)]
    words = {True: "yes", False: "no", None: ""}
    heads, rows = ("figure", "found", "unit", "beside", "target", "met"), list[list[str]]()
    for one in shown:
        beside = f"{one.reference_name.rpartition('.')[2]} {number(one.reference)}" if one.reference is not None else ""
        rows.append([one.name, number(one.value), one.unit, beside, one.target, words[one.met]])
    lines = [
        f"{document['created_utc'][:10]}, {'a quick run' if document['quick'] else 'a full run'}: "
        f"{machine_line(Machine.model_validate(document['machine']))}.",
        "",
        markdown_table(heads, rows, num_text=1),
    ]
    if document["left_out"]:
        lines += ["", f"Left out of this run: {', '.join(document['left_out'])}."]
    return "\n".join(["", *lines, "", ""])


def main() -> None:
    """Reads FOLDER and rewrites PAGE."""
    folder, page = (Path(argument) for argument in sys.argv[1:])
    page.write_text(rewritten(page.read_text(), folder))
    print(f"Written to {page}")


if __name__ == "__main__":
    main()
