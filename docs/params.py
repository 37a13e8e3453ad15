"""The tables of parameters and constants in these pages, from the code that declares them.

    python docs/params.py            rewrite what stands between the marks in docs/*.md
    python docs/params.py --check    say which pages are behind, status 1

A mark is `<!-- params MODULE:NODE [NAME ...] -->` for a node's parameters (all of them, or those named), or
`<!-- constants MODULE:CLASS -->` for a frozen dataclass whose fields have a line below them; `<!-- end -->` closes it.
"""

import argparse
import ast
import importlib
import inspect
import re
import sys
from collections.abc import Sequence
from pathlib import Path
from textwrap import dedent
from typing import Any

from bunraku.runtime.params import params_of

HERE = Path(__file__).resolve().parent
MARK = re.compile(r"(<!-- (params|constants) (\S+:\w+)((?: \w+)*) -->\n)(.*?)(<!-- end -->)", re.DOTALL)


def value_text(value: Any) -> str:
    """A default as one types it."""
    if isinstance(value, bool):
        return "true" if value else "false"
    if isinstance(value, float):
        return f"{value:.5g}"
    if isinstance(value, list | tuple):
        return ", ".join(value_text(one) for one in value) or "empty"
    return str(value) or "empty"


def params_table(node: type[Any], names: Sequence[str]) -> list[str]:
    """The rows of a node's parameters."""
    declared = params_of(node)
    rows = ["| parameter | default | range | meaning |", "|---|---|---|---|"]
    for name in names or declared:
        one = declared[name]
        span = ", ".join(one.choices) if one.choices else ""
        if one.low is not None and one.high is not None:
            span = f"{one.low:g} to {one.high:g}"
        rows.append(f"| `{name}` | {value_text(one.default)} | {span} | {one.doc.replace('|', '/')} |")
    return rows


def constants_table(kind: type[Any]) -> list[str]:
    """The rows of a dataclass's fields, with the line that stands below each."""
    tree = ast.parse(dedent(inspect.getsource(kind))).body[0]
    assert isinstance(tree, ast.ClassDef)
    rows = ["| constant | value | meaning |", "|---|---|---|"]
    name = ""
    for part in tree.body:
        if isinstance(part, ast.AnnAssign) and isinstance(part.target, ast.Name):
            name = part.target.id
        elif name and isinstance(part, ast.Expr) and isinstance(part.value, ast.Constant):
            says = " ".join(str(part.value.value).split()).replace("|", "\\|")
            rows.append(f"| `{name}` | {value_text(getattr(kind(), name))} | {says} |")
            name = ""
    return rows


def rewritten(text: str) -> str:
    """A page with its tables as the code has them now."""

    def table(found: re.Match[str]) -> str:
        module, _, name = found[3].partition(":")
        kind = getattr(importlib.import_module(module), name)
        rows = params_table(kind, found[4].split()) if found[2] == "params" else constants_table(kind)
        return found[1] + "\n" + "\n".join(rows) + "\n\n" + found[6]

    return MARK.sub(table, text)


def main(argv: Sequence[str] | None = None) -> int:
    """Rewrite the pages, or check them."""
    parser = argparse.ArgumentParser(description=(__doc__ or "").split("\n")[0])
    parser.add_argument("--check", action="store_true", help="change nothing")
    args = parser.parse_args(argv)
    behind = []
    for page in sorted(HERE.glob("*.md")):
        text = page.read_text(encoding="utf-8")
        new = rewritten(text)
        if new != text:
            behind.append(page.name)
            if not args.check:
                page.write_text(new, encoding="utf-8")
    if behind:
        print(f"{'behind the code' if args.check else 'rewritten'}: {', '.join(behind)}")
    return 1 if behind and args.check else 0


if __name__ == "__main__":
    sys.exit(main())
