"""Launch files: plain typed Python functions that return what is to run.

A launch file defines ``launch(...) -> list[NodeSpec]``. Its signature is its command line, its docstring the
help, ``if`` and ``for`` are the conditions, and nothing starts while it runs::

    def launch(source: Literal["web", "tuio"] = "web", record: bool = False) -> list[NodeSpec]:
        \"\"\"Touch and drag the figure.\"\"\"
        return [node("input_touch", params={"driver": source}), node("controller", respawn=True)]
"""

import contextlib
import difflib
import importlib
import importlib.util
import inspect
import math
import pkgutil
import re
import sys
import traceback
import types
import typing
from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import asdict, dataclass, field, replace
from pathlib import Path
from typing import Any, Literal

NAME = re.compile(r"[a-z0-9_]+(/[a-z0-9_]+)*")


class LaunchError(ValueError):
    """A launch file that cannot be used: one line for each fault, naming file and key."""

    def __init__(self, *faults: str) -> None:
        super().__init__("\n".join(faults))
        self.faults = faults


@dataclass(frozen=True)
class NodeSpec:
    """One process that a launch file asks for."""

    kind: str
    """Name in the table of nodes (`bunraku.nodes.NODES`)."""
    name: str
    """Name that it runs under, without the namespace."""
    params: Mapping[str, Any] = field(default_factory=dict)
    remap: Mapping[str, str] = field(default_factory=dict)
    """Topic as the node's source says it -> topic on the stage."""
    ns: str = ""
    respawn: bool = False
    """Started again, with back-off and a limit, when it dies."""
    required: bool = False
    """Its end ends the stack."""
    env: Mapping[str, str] = field(default_factory=dict)
    stop: float = 5.0
    """Seconds that it may take to finish after an interrupt."""
    command: tuple[str, ...] = ()
    """Words after ``bunraku`` that start it; empty: ``run KIND`` with the above."""
    file: str = ""
    """Launch file that asked for it."""

    @property
    def path(self) -> str:
        """Its full name: namespace and name."""
        return f"{self.ns}/{self.name}" if self.ns else self.name

    def fault(self, key: str, text: str) -> str:
        """A line about one of its keys."""
        return f"{self.file or 'launch'}: {self.path}: {key}: {text}"

    def as_dict(self) -> dict[str, Any]:
        """Plain values, for --show --json."""
        return {**asdict(self), "path": self.path}


_files: list[str] = []
"""The launch files being read, outermost first."""


def node(
    kind: str,
    *,
    params: Mapping[str, Any] | None = None,
    remap: Mapping[str, str] | None = None,
    ns: str = "",
    name: str | None = None,
    respawn: bool = False,
    required: bool = False,
    env: Mapping[str, str] | None = None,
    stop: float = 5.0,
) -> NodeSpec:
    """Ask for a node; see `NodeSpec` for what the keys mean."""
    return NodeSpec(
        kind=kind,
        name=kind if name is None else name,
        params=dict(params or {}),
        remap=dict(remap or {}),
        ns=ns,
        respawn=respawn,
        required=required,
        env={key: str(value) for key, value in (env or {}).items()},
        stop=stop,
        file=_files[-1] if _files else "",
    )


def group(ns: str, specs: Iterable[NodeSpec]) -> list[NodeSpec]:
    """The same nodes in a namespace (inside which they may have their own)."""
    return [replace(spec, ns=f"{ns}/{spec.ns}" if spec.ns else ns) for spec in specs]


def include(name: str, **arguments: Any) -> list[NodeSpec]:
    """What another launch file asks for; a relative path counts from the file that includes."""
    base = Path(_files[-1]).parent if _files else None
    return LaunchFile.find(name, base).specs(arguments)


def names() -> list[str]:
    """The launch files that come with the package."""
    found = (module.name for module in pkgutil.iter_modules(importlib.import_module("bunraku.launch").__path__))
    return sorted(name for name in found if not name.startswith("_"))


@dataclass(frozen=True)
class Argument:
    """One argument of a launch file, typed by the signature."""

    name: str
    type: Any
    default: Any

    @property
    def choices(self) -> tuple[Any, ...]:
        """The values of a Literal, else nothing."""
        return typing.get_args(self.type) if typing.get_origin(self.type) is Literal else ()

    @property
    def required(self) -> bool:
        """It has no default."""
        return self.default is inspect.Parameter.empty

    def describe(self) -> str:
        """Its type in words."""
        if self.choices:
            return "|".join(map(str, self.choices))
        return "list, comma between" if self.type == list[str] else str(self.type.__name__)

    def parse(self, word: str) -> Any:
        """The value of a word of the command line; raises ValueError that says what is wanted."""
        if self.choices:
            for choice in self.choices:
                if str(choice) == word:
                    return choice
            close = difflib.get_close_matches(word, [str(c) for c in self.choices], 1, 0.5)
            hint = f"; did you mean {close[0]}?" if close else ""
            raise ValueError(f"{word!r} is none of {', '.join(map(str, self.choices))}{hint}")
        if self.type == list[str]:
            return [part.strip() for part in word.split(",") if part.strip()]
        return parse_value(self.type, word)

    def check(self, value: Any) -> Any:
        """The value as its type (an int where a float is wanted becomes one); raises ValueError."""
        if self.choices:
            if value not in self.choices:
                raise ValueError(f"{value!r} is none of {', '.join(map(str, self.choices))}")
            return value
        if self.type == list[str]:
            if isinstance(value, str) or not all(isinstance(part, str) for part in value):
                raise ValueError(f"{value!r} is no list of words")
            return list(value)
        return check_value(self.type, value)


def parse_value(type_: type, word: str) -> Any:
    """A bool, int, float or str from a word; raises ValueError that says what is wanted."""
    if type_ is str:
        return word
    if type_ is bool:
        known = {
            "true": True,
            "yes": True,
            "on": True,
            "1": True,
            "false": False,
            "no": False,
            "off": False,
            "0": False,
        }
        if word.lower() not in known:
            raise ValueError(f"{word!r} is neither true nor false")
        return known[word.lower()]
    try:
        value = type_(word)
    except ValueError:
        raise ValueError(f"{word!r} is no {'whole number' if type_ is int else 'number'}") from None
    return check_value(type_, value)


def check_value(type_: type, value: Any) -> Any:
    """The value if it has the type (ints pass for floats); raises ValueError that says what is wanted."""
    wanted = {bool: "true or false", int: "a whole number", float: "a number", str: "text"}[type_]
    if type_ is float and isinstance(value, int) and not isinstance(value, bool):
        value = float(value)
    if not isinstance(value, type_) or (type_ is not bool and isinstance(value, bool)):
        raise ValueError(f"{value!r} is not {wanted}")
    if isinstance(value, float) and not math.isfinite(value):
        raise ValueError(f"{value!r} is not finite")
    return value


def _argument(file: str, parameter: inspect.Parameter, hints: Mapping[str, Any]) -> Argument:
    name = parameter.name
    if parameter.kind not in (parameter.POSITIONAL_OR_KEYWORD, parameter.KEYWORD_ONLY):
        raise LaunchError(f"{file}: launch: {name}: arguments are named one by one, *args and **kwargs cannot be set")
    type_ = hints.get(name)
    origin = typing.get_origin(type_)
    if type_ not in (bool, int, float, str) and origin is not Literal and type_ != list[str]:
        raise LaunchError(
            f"{file}: launch: {name}: needs a type that a command line can set: "
            "bool, int, float, str, list[str] or Literal[...]"
        )
    argument = Argument(name, type_, parameter.default)
    if not argument.required:
        try:
            argument.check(argument.default)
        except (ValueError, TypeError) as error:
            raise LaunchError(f"{file}: launch: {name}: default {error}") from None
    return argument


@dataclass(frozen=True)
class LaunchFile:
    """A launch file: its function and what its signature says."""

    file: str
    """The path as it is shown in messages."""
    function: Any
    arguments: Mapping[str, Argument]

    @property
    def doc(self) -> str:
        """The first line of `help`."""
        return self.help.partition("\n")[0]

    @property
    def help(self) -> str:
        """The function's docstring, or the module's."""
        text = inspect.getdoc(self.function) or self.function.__globals__.get("__doc__") or ""
        return str(text).strip()

    @classmethod
    def find(cls, name: str, base: Path | None = None) -> "LaunchFile":
        """Read a launch file by its name in the package or by its path; raises `LaunchError`."""
        if name.endswith(".py"):
            path = Path(name).expanduser()
            if base is not None and not path.is_absolute():
                path = base / path
            return cls._of(_load_path(path), str(path))
        known = names()
        if name not in known:
            close = difflib.get_close_matches(name, known, 1, 0.5)
            hint = f", did you mean {close[0]!r}?" if close else ""
            raise LaunchError(f"{name}: no such launch file{hint} (there is: {', '.join(known)}, or give a FILE.py)")
        try:
            module = importlib.import_module(f"bunraku.launch.{name}")
        except LaunchError:
            raise
        except Exception as error:
            raise LaunchError(f"launch/{name}.py: {_describe(error, '')}") from error
        return cls._of(module, str(module.__file__))

    @classmethod
    def _of(cls, module: types.ModuleType, path: str) -> "LaunchFile":
        file = shorten(path)
        function = getattr(module, "launch", None)
        if not callable(function):
            raise LaunchError(f"{file}: launch: missing; define launch(...) -> list[NodeSpec]")
        try:
            hints = typing.get_type_hints(function)
        except Exception as error:
            raise LaunchError(f"{file}: launch: {_describe(error, path)}") from error
        parameters = inspect.signature(function).parameters.values()
        return cls(path, function, {p.name: _argument(file, p, hints) for p in parameters})

    def parse(self, words: Sequence[str]) -> dict[str, Any]:
        """``arg:=value`` words as typed values; raises `LaunchError`, one line for each wrong word."""
        values: dict[str, Any] = {}
        faults = []
        for word in words:
            key, sign, text = word.partition(":=")
            if not sign:
                faults.append(f"{self.shown}: {word!r} is no argument; write name:=value")
            elif key not in self.arguments:
                faults.append(self._unknown(key))
            else:
                try:
                    values[key] = self.arguments[key].parse(text)
                except ValueError as error:
                    faults.append(f"{self.shown}: {key}: {error}")
        if faults:
            raise LaunchError(*faults)
        return values

    @property
    def shown(self) -> str:
        """The file as messages name it."""
        return shorten(self.file)

    def _unknown(self, key: str) -> str:
        close = difflib.get_close_matches(key, self.arguments, 1, 0.5)
        hint = f", did you mean {close[0]!r}?" if close else ""
        has = f"has: {', '.join(self.arguments)}" if self.arguments else "it takes none"
        return f"{self.shown}: {key}: no such argument{hint} ({has})"

    def specs(self, values: Mapping[str, Any]) -> list[NodeSpec]:
        """What the file asks for with these arguments; raises `LaunchError`."""
        faults = [self._unknown(key) for key in values if key not in self.arguments]
        checked: dict[str, Any] = {}
        for name, argument in self.arguments.items():
            if name in values:
                try:
                    checked[name] = argument.check(values[name])
                except (ValueError, TypeError) as error:
                    faults.append(f"{self.shown}: {name}: {error}")
            elif argument.required:
                faults.append(f"{self.shown}: {name}: missing; give {name}:=VALUE ({argument.describe()})")
        if faults:
            raise LaunchError(*faults)
        with _reading(self.file):
            try:
                result = self.function(**checked)
            except LaunchError:
                raise
            except RecursionError:
                raise LaunchError(f"{self.shown}: launch: calls itself without end") from None
            except Exception as error:
                raise LaunchError(f"{self.shown}: {_describe(error, self.file)}") from error
        if not isinstance(result, list) or not all(isinstance(spec, NodeSpec) for spec in result):
            raise LaunchError(f"{self.shown}: launch: must return a list of node(...), *include(...), *group(...)")
        return result


@contextlib.contextmanager
def _reading(file: str) -> Iterator[None]:
    """Keep the chain of includes; refuse a cycle."""
    here = str(Path(file).resolve())
    chain = [str(Path(name).resolve()) for name in _files]
    if here in chain:
        names_ = [shorten(name) for name in [*_files[chain.index(here) :], file]]
        raise LaunchError(f"{shorten(_files[-1])}: include: a cycle: {' -> '.join(names_)}")
    _files.append(file)
    try:
        yield
    finally:
        _files.pop()


def _load_path(path: Path) -> types.ModuleType:
    file = shorten(str(path))
    if not path.is_file():
        raise LaunchError(f"{file}: no such launch file; check the path (or give a name: {', '.join(names())})")
    name = "bunraku_launch_" + re.sub(r"\W", "_", str(path.resolve()))
    spec = importlib.util.spec_from_file_location(name, path)
    assert spec is not None
    assert spec.loader is not None
    module = importlib.util.module_from_spec(spec)
    sys.modules[name] = module
    try:
        spec.loader.exec_module(module)
    except LaunchError:
        raise
    except Exception as error:
        raise LaunchError(f"{file}: {_describe(error, str(path))}") from error
    finally:
        sys.modules.pop(name, None)
    return module


def shorten(path: str) -> str:
    """A path as messages show it: within the package, relative to the working folder, or whole."""
    if not path:
        return path
    absolute = Path(path).absolute()
    if absolute.parent in (_PACKAGE / "launch", _PACKAGE.parent / "launch"):
        return f"launch/{absolute.name}"
    with contextlib.suppress(ValueError):
        return str(absolute.relative_to(Path.cwd()))
    return path


_PACKAGE = Path(__file__).absolute().parent.parent


def _describe(error: Exception, file: str) -> str:
    """An error of a launch file's own code in one line, with the line of the file where it can be told."""
    text = f"{type(error).__name__}: {error}".replace("\n", " ")
    if isinstance(error, SyntaxError):
        return f"line {error.lineno}: {type(error).__name__}: {error.msg}"
    here = str(Path(file).absolute())
    lines = [
        line
        for frame, line in traceback.walk_tb(error.__traceback__)
        if str(Path(frame.f_code.co_filename).absolute()) == here
    ]
    return f"line {lines[-1]}: {text}" if lines else text
