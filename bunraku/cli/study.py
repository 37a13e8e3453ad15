"""Scored tasks and measurements, each a module of the folder studies/ with tables as its result.

bunraku study                 what there is
bunraku study touch --seeds 20 -o study-touch
"""

import argparse
import importlib.util
import sys
from pathlib import Path
from types import ModuleType

from bunraku.cli import USAGE, Problem, nearest

FOLDER = Path(__file__).resolve().parents[2] / "studies"


def add(parser: argparse.ArgumentParser) -> None:
    """Declare the arguments."""
    parser.intermixed = False  # type: ignore[attr-defined]  # what follows the name is the study's own
    parser.add_argument("name", nargs="?", metavar="NAME", help="which study; without it they are listed")
    parser.add_argument("rest", nargs=argparse.REMAINDER, metavar="...", help="its own arguments, see NAME --help")


def run(args: argparse.Namespace) -> int:
    """Run a study, or list them."""
    found = studies()
    if not found:
        raise Problem(f"no studies in {FOLDER}: they come with the source; clone the repository", USAGE)
    if args.name is None:
        wide = max(len(name) for name in found)
        for name, path in found.items():
            print(f"{name:{wide}}  {_line(path)}")
        return 0
    if args.name not in found:
        raise Problem(
            f"no study is named {args.name!r}{nearest(args.name, found)} (there is: {', '.join(found)})", USAGE
        )
    module = load(args.name, found[args.name])
    words = sys.argv
    sys.argv = [f"bunraku study {args.name}", *args.rest]
    try:
        return int(module.main() or 0)
    finally:
        sys.argv = words


def studies() -> dict[str, Path]:
    """The studies by name: a module, or a folder with one called study."""
    if not FOLDER.is_dir():
        return {}
    files = {path.stem: path for path in FOLDER.glob("*.py") if not path.stem.startswith("_")}
    folders = {path.parent.name: path for path in FOLDER.glob("*/study.py")}
    return dict(sorted({**files, **folders}.items()))


def load(name: str, path: Path) -> ModuleType:
    """Import a study under a name of its own; a folder becomes a package, a file finds those beside it."""
    package = f"bunraku_study_{name}"
    if path.name == "study.py":
        _import(package, path.with_name("__init__.py"), [str(path.parent)])
        return _import(f"{package}.study", path, None)
    if str(path.parent) not in sys.path:
        sys.path.append(str(path.parent))
    return _import(package, path, None)


def _import(name: str, path: Path, places: list[str] | None) -> ModuleType:
    spec = importlib.util.spec_from_file_location(name, path, submodule_search_locations=places)
    if spec is None or spec.loader is None:
        raise Problem(f"{path} cannot be imported; check the file", USAGE)
    module = importlib.util.module_from_spec(spec)
    sys.modules[name] = module
    spec.loader.exec_module(module)
    return module


def _line(path: Path) -> str:
    """The first line of a study's docstring."""
    import ast

    text = ast.get_docstring(ast.parse(path.read_text(encoding="utf-8"))) or ""
    return text.split("\n")[0]
