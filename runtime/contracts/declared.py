"""What a part's class says of itself in plain literals, read from its source: `srl list` imports no part for a line.

Where the source doesn't tell (a value that is computed, a module without source, an import that can't be found), the
answer is None, and the caller imports the part: so what can't be imported is still reported by the import itself. A
library that is there but broken isn't noticed here; `srl check` and `srl run` import what a profile uses.
"""

from __future__ import annotations

import ast
import importlib.util
import re
import sys
from collections.abc import Iterator, Sequence
from functools import cache
from importlib.machinery import ModuleSpec, PathFinder
from pathlib import Path
from typing import Any

_IMPORT = re.compile(r"^(?:from[ \t]+([\w.]+)[ \t]+import\b|import[ \t]+([^#\n]+))", re.MULTILINE)
_MISSING = object()
_DEPTH = 20  # re-exports of a name, one after the other


def declared(point: str, names: Sequence[str]) -> dict[str, Any] | None:
    """The class attributes `names` of an entry point, without importing it.

    Args:
        point: "package.module:Class".
        names: the attributes, as they stand in the class's body or in that of a class it inherits from.
    Returns:
        Their values by name; None if the source doesn't tell them all, or something that it imports isn't there.
    """
    module, _, name = point.partition(":")
    try:
        if not _importable(module):
            return None
        found = {wanted: _attribute(module, name, wanted) for wanted in names}
    except (OSError, SyntaxError, ValueError, RecursionError):
        return None
    return None if _MISSING in found.values() else found


@cache
def _spec(module: str) -> ModuleSpec | None:
    """The module's spec, without importing the packages above it, as `importlib.util.find_spec` would."""
    parent = module.rpartition(".")[0]
    if module in sys.modules:
        return getattr(sys.modules[module], "__spec__", None)  # None stands there for what may not be imported
    if not parent:
        return importlib.util.find_spec(module)
    above = _spec(parent)
    if above is None or above.submodule_search_locations is None:
        return None
    return PathFinder.find_spec(module, list(above.submodule_search_locations))


@cache
def _text(module: str) -> str | None:
    """The module's source; None if it has none."""
    spec = _spec(module)
    if spec is None or spec.origin is None or not spec.origin.endswith(".py"):
        return None
    return Path(spec.origin).read_text(encoding="utf-8")


def _imports(text: str) -> Iterator[str]:
    """The modules that are imported whenever this source is: its imports without indentation."""
    for source, plain in _IMPORT.findall(text):
        yield from [source] if source else [entry.split()[0] for entry in plain.split(",") if entry.split()]


def _importable(module: str) -> bool:
    """Whether the module is there, what it imports of its own package and ours, and the libraries they name."""
    ours = {module.partition(".")[0], "srl"}
    todo, seen = [module], set[str]()
    while todo:
        name = todo.pop()
        if name in seen:
            continue
        seen.add(name)
        if name.startswith("."):
            return False  # relative: the import itself knows best
        top = name.partition(".")[0]
        if _spec(name if top in ours else top) is None:
            return False
        if top in ours:
            todo += _needed(name)
            if "." in name:
                todo.append(name.rpartition(".")[0])  # a package is imported before what is in it
    return True


@cache
def _needed(module: str) -> tuple[str, ...]:
    return tuple(_imports(_text(module) or ""))


@cache
def _tree(module: str) -> ast.Module | None:
    text = _text(module)
    return None if text is None else ast.parse(text)


def _bound(module: str, name: str, depth: int = 0) -> tuple[str, ast.AST] | None:
    """What a module's global name is: the module that says it, and its class or value there. Follows imports."""
    tree = _tree(module)
    if tree is None or depth > _DEPTH:
        return None
    found: list[tuple[str, ast.AST] | None] = []
    for node in tree.body:
        if isinstance(node, ast.ClassDef) and node.name == name:
            found.append((module, node))
        elif name in _assigned(node):
            found.append((module, node.value) if isinstance(node, ast.Assign | ast.AnnAssign) and node.value else None)
        elif isinstance(node, ast.ImportFrom) and node.module is not None and not node.level:
            for alias in node.names:
                if (alias.asname or alias.name) == name:
                    part = f"{node.module}.{alias.name}"
                    inner = _bound(node.module, alias.name, depth + 1)
                    found.append(inner if inner or not _spec(part) else (part, ast.Module([], [])))
    return found[0] if len(found) == 1 else None


def _assigned(node: ast.AST) -> list[str]:
    """The names to which a statement assigns."""
    if isinstance(node, ast.Assign):
        targets = node.targets
    else:
        targets = [node.target] if isinstance(node, ast.AnnAssign | ast.AugAssign) else []
    return [target.id for target in targets if isinstance(target, ast.Name)]


def _attribute(module: str, name: str, wanted: str) -> Any:
    """The value of a class's attribute, its own or the first base's that has one; _MISSING if that isn't plain."""
    bound = _bound(module, name)
    if bound is None or not isinstance(cls := bound[1], ast.ClassDef) or cls.decorator_list or cls.keywords:
        return _MISSING  # a decorator, or a metaclass, may change the class
    for node in cls.body:
        if wanted in _assigned(node):
            return _value(bound[0], node.value) if isinstance(node, ast.Assign | ast.AnnAssign) else _MISSING
    for base in cls.bases:
        plain = base.value if isinstance(base, ast.Subscript) else base  # of Law[Config], Law
        found = _attribute(bound[0], plain.id, wanted) if isinstance(plain, ast.Name) else _MISSING
        if found is not _MISSING:
            return found
    return _MISSING


def _value(module: str, node: ast.AST | None) -> Any:
    """The value of a literal, of a name for one, or of a tuple of them; else _MISSING."""
    if isinstance(node, ast.Tuple):
        values = tuple(_value(module, entry) for entry in node.elts)
        return _MISSING if _MISSING in values else values
    if isinstance(node, ast.Name):
        bound = _bound(module, node.id)
        return _MISSING if bound is None else _value(*bound)
    if isinstance(node, ast.Attribute) and isinstance(node.value, ast.Name):
        bound = _bound(module, node.value.id)
        inner = _bound(bound[0], node.attr) if bound is not None and isinstance(bound[1], ast.Module) else None
        return _MISSING if inner is None else _value(*inner)
    return node.value if isinstance(node, ast.Constant) else _MISSING
