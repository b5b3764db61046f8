"""Plug-ins: users' own objects, named `package.module:factory`. Options, functions and checks all find them here.

The module is also looked for in the current folder, and the factory is called without arguments unless the option says
otherwise. A run keeps `plugin_digest`, so that answers of changed code are never mixed with older ones.
"""

import ast
import hashlib
import importlib
import importlib.util
import os
import pickle
import re
import subprocess
import sys
from collections.abc import Callable, Iterator, Sequence
from pathlib import Path
from typing import Any

from sim.errors import AgentError, PersonalVizError

_FORM = re.compile(r"[A-Za-z_]\w*(\.[A-Za-z_]\w*)*:[A-Za-z_]\w*(\.[A-Za-z_]\w*)*")
_OURS = frozenset({"sim", "grounding", "human_study", "recordings", "personal_viz"})
_CHILD = """
import os, pickle, sys
answer = os.fdopen(os.dup(1), "wb")
os.dup2(2, 1)
try:
    function, arguments = pickle.load(sys.stdin.buffer)
except Exception:
    sys.exit(3)
pickle.dump(function(*arguments), answer)
answer.close()
"""
_UNSENT = 3
"""Exit code of a second process to which the plug-in cannot be sent, such as a class of a script."""


def is_plugin(name: str) -> bool:
    """Whether a name has the form `package.module:factory`."""
    return _FORM.fullmatch(name) is not None


def build_plugin(name: str, *arguments: Any, option: str = "plug-in", methods: Sequence[str] = ()) -> Any:
    """The object that the factory of a plug-in makes.

    Args:
        name: `package.module:factory`.
        arguments: Arguments of the factory.
        option: The option that named the plug-in, such as `--agent`.
        methods: Methods that the object must have.

    Raises:
        AgentError: The name has another form, the plug-in cannot be imported or built, or lacks a method.
    """
    if not is_plugin(name):
        raise AgentError(f"{option} is {name!r}; expected your own as package.module:factory. See --help for others.")
    module, _, factory = name.partition(":")
    _see_present_folder()
    try:
        made: Any = importlib.import_module(module)
        for part in factory.split("."):
            made = getattr(made, part)
        made = made(*arguments)
    except Exception as error:  # the plug-in door: the message names the error of the user's code
        raise AgentError(f"{name}: {type(error).__name__} while it was built: {error}. Correct the plug-in.") from error
    return require_methods(made, methods, where=name, need=option)


def call_plugin(kind: str, function: Callable[..., Any], *args: Any, **kwargs: Any) -> Any:
    """Calls a factory or a method of the user's plug-in and returns its result.

    Raises:
        AgentError: It raised something; the message asks to correct the `kind`, such as "agent".
        PersonalVizError: It raised this, which already says what to do.
    """
    try:
        return function(*args, **kwargs)
    except PersonalVizError:
        raise
    except Exception as error:  # the plug-in door
        name = getattr(function, "__qualname__", "the factory").rpartition("<locals>.")[2]
        reason = " ".join(str(error).split())
        raise AgentError(f"{name}() raised {type(error).__name__}: {reason}. Correct the {kind}.") from error


def require_methods(made: Any, methods: Sequence[str], *, where: str, need: str) -> Any:
    """The plug-in itself, with all methods.

    Raises:
        AgentError: It lacks one.
    """
    for method in methods:
        if not callable(getattr(made, method, None)):
            raise AgentError(
                f"{where}: found no method {method}(); expected one, because {need} needs it. Correct the plug-in."
            )
    return made


def own_name(made: object, fallback: str) -> str:
    """The plug-in's own name, its attribute `name`; `fallback` where it has none."""
    name = getattr(made, "name", None)
    return name if isinstance(name, str) and name else fallback


def plugin_digest(name: str) -> str:
    """SHA-256 of the plug-in's source: its module and the modules that it imports from the same folder, 16 hex digits.

    Our own packages count by their version, not here; modules that are found only while the plug-in runs do not count.

    Raises:
        AgentError: The module cannot be found.
    """
    module = name.partition(":")[0]
    _see_present_folder()
    try:
        spec = importlib.util.find_spec(module)
    except (ImportError, ValueError) as error:
        raise AgentError(f"{name}: cannot be found ({error}); expected a module. Correct the name.") from None
    if spec is None or spec.origin is None or not Path(spec.origin).is_file():
        raise AgentError(f"{name}: has no source file; expected a Python module. Correct the name.")
    start = Path(spec.origin)
    up = module.count(".") + (start.name == "__init__.py")
    root = start.parents[up]
    digest = hashlib.sha256()
    for path in sorted(_sources(start, module, root)):
        digest.update(path.relative_to(root).as_posix().encode() + b"\0" + path.read_bytes() + b"\0")
    return digest.hexdigest()[:16]


def _see_present_folder() -> None:
    """Lets modules be found in the current folder, as with `python -m`; an installed program does not look there."""
    if os.getcwd() not in sys.path:
        sys.path.insert(0, os.getcwd())


def _sources(start: Path, module: str, root: Path) -> set[Path]:
    """The module's file and those of modules below `root` that it imports, and so on."""
    found: set[Path] = set()
    waiting = [(start, module)]
    while waiting:
        path, name = waiting.pop()
        if path in found:
            continue
        found.add(path)
        for imported in _imports(path, name):
            for part in range(1, imported.count(".") + 2):  # packages on the way run too
                parent = ".".join(imported.split(".")[:part])
                base = root.joinpath(*parent.split("."))
                files = (base / "__init__.py", base.with_suffix(".py"))
                waiting += [(file, parent) for file in files if file.is_file()]
    return found


def _imports(path: Path, module: str) -> Iterator[str]:
    """Full names that a module imports, each written as a module even if it is not one; ours are left out."""
    package = module if path.name == "__init__.py" else module.rpartition(".")[0]
    try:
        tree = ast.parse(path.read_bytes())
    except SyntaxError:
        return
    for node in ast.walk(tree):
        names: list[str] = []
        if isinstance(node, ast.Import):
            names = [alias.name for alias in node.names]
        elif isinstance(node, ast.ImportFrom):
            above = ".".join(package.split(".")[: package.count(".") + 2 - node.level]) if node.level else ""
            base = ".".join(part for part in (above, node.module) if part)
            names = [".".join(part for part in (base, alias.name) if part) for alias in node.names]
        yield from (name for name in names if name.partition(".")[0] not in _OURS)


def problems_of(
    plugin: object | Callable[..., Any] | str,
    check: Callable[[Any], None],
    *,
    methods: Sequence[str],
    again: Callable[[Any], Any],
    arguments: Sequence[Any] = (),
    kind: str = "plug-in",
) -> list[str]:
    """Runs a check: makes the plug-in, checks it here, and repeats the questions in a second process.

    Args:
        plugin: The object, a factory, or its name as package.module:factory.
        check: Raises AgentError at the first breach of the contract.
        methods: Methods that the object must have.
        again: A module-level function whose answer must be the same here and in a second process, where Python's
            `hash()` gives other numbers. Left out for a plug-in that cannot be sent there, such as a class of a script.
        arguments: Arguments of the factory.
        kind: The kind of plug-in, for errors.

    Returns:
        One sentence per problem; empty = the contract is kept.
    """
    try:
        made = made_of(plugin, methods=methods, arguments=arguments, kind=kind)
        check(made)
        difference = _difference(plugin, made, again, methods, tuple(arguments))
    except AgentError as error:
        return [str(error)]
    except Exception as error:  # the plug-in door
        reason = " ".join(str(error).split())
        return [f"{kind}: raised {type(error).__name__}: {reason}. Correct the plug-in."]
    return [] if difference is None else [f"{kind} {own_name(made, '')!r}: {difference}"]


def made_of(
    plugin: object | Callable[..., Any] | str,
    *,
    methods: Sequence[str],
    arguments: Sequence[Any] = (),
    kind: str = "plug-in",
) -> Any:
    """The object itself, or the object made by the factory or by the factory that the name gives.

    Raises:
        AgentError: It cannot be built, or lacks a method.
    """
    if isinstance(plugin, str):
        return build_plugin(plugin, *arguments, option=kind, methods=methods)
    if isinstance(plugin, type) or (callable(plugin) and not hasattr(plugin, methods[0])):
        plugin = call_plugin(kind, plugin, *arguments)
    return require_methods(plugin, methods, where=kind, need="the contract")


def second_answer(
    plugin: object, again: Callable[[Any], Any], *, methods: Sequence[str], arguments: Sequence[Any] = ()
) -> tuple[Any] | None:
    """The answer of `again` in a second process, in a tuple; None where the plug-in cannot be sent there.

    Raises:
        AgentError: The second process failed.
    """
    try:
        sent = pickle.dumps((_answer, (plugin, again, tuple(methods), tuple(arguments))))
    except Exception:  # a class in a function, a model on a device, an open file
        return None
    seed = "1" if os.environ.get("PYTHONHASHSEED") != "1" else "2"
    environment = {**os.environ, "PYTHONHASHSEED": seed, "PYTHONPATH": os.pathsep.join(filter(None, sys.path))}
    done = subprocess.run([sys.executable, "-c", _CHILD], input=sent, capture_output=True, env=environment)
    if done.returncode == _UNSENT:
        return None
    if done.returncode:
        lines = done.stderr.decode(errors="replace").strip().splitlines() or ["no error text"]
        raise AgentError(f"in a second process: {lines[-1]}. Correct the plug-in.")
    return (pickle.loads(done.stdout),)


def _answer(plugin: Any, again: Callable[[Any], Any], methods: tuple[str, ...], arguments: tuple[Any, ...]) -> Any:
    """The work of the second process."""
    return again(made_of(plugin, methods=methods, arguments=arguments))


def _difference(
    plugin: object, made: Any, again: Callable[[Any], Any], methods: Sequence[str], arguments: tuple[Any, ...]
) -> str | None:
    second = second_answer(plugin, again, methods=methods, arguments=arguments)
    if second is None or _same(again(made), second[0]):
        return None
    return (
        "a second process gives another answer to the same question; expected the same answer, because worker "
        "processes and later runs share maps. Use hashlib instead of hash(), and do not draw without a seed."
    )


def _same(first: Any, second: Any) -> bool:
    """Whether two answers are equal, arrays up to rounding."""
    if isinstance(first, tuple | list) and isinstance(second, tuple | list):
        return len(first) == len(second) and all(map(_same, first, second))
    if hasattr(first, "shape"):
        import numpy as np

        return bool(np.shape(first) == np.shape(second) and np.allclose(first, second, atol=1e-3))
    return bool(first == second)
