"""`srl new device`: writes a package with a driver, its fake, its twin, a profile and tests that pass as written.

The package is that in the folder `device` beside this file, with another name.
"""

from __future__ import annotations

import argparse
import ast
import importlib.util
import os
import re
import shlex
import shutil
import tempfile
from collections.abc import Iterator
from importlib import resources
from importlib.resources.abc import Traversable
from pathlib import Path, PurePosixPath

from srl.runtime.contracts import registry
from srl.runtime.contracts.errors import RequestError

NAME = r"[a-z][a-z0-9]*([-_][a-z0-9]+)*"
LONGEST = 40
OF_PROFILES = {
    "template": "--from", "set": "--set", "port": "--port", "yes": "--yes", "urdf": "--urdf", "split": "--split",
}  # fmt: skip


def write(args: argparse.Namespace) -> int:
    """Writes the package and says what comes next. Returns 0; what is wrong is raised, and nothing written."""
    for option, typed in OF_PROFILES.items():
        if getattr(args, option):
            raise RequestError(typed, "it is for a profile, and this is a device", "Leave it out")
    check_name(args.device)
    target = Path(args.out or f"srl-{args.device}")
    _check_target(target)
    _write_whole(target, package(args.device))
    files = sorted(package(args.device))
    print(f"{target}: a package with driver, fake, twin, profile and tests ({len(files)} files)")
    print("Next:")
    for line in (
        f"cd {shlex.quote(str(target))}", "pip install --no-deps --editable .",
        "python -m pytest", f"srl run {args.device}.yaml --sim --duration 5",
    ):  # fmt: skip
        print(f"  {line}")
    print("Then make it yours; its README.md says in which order.")
    return 0


def package(name: str) -> dict[str, str]:
    """The package's files: text by path, as "srl_force_plate/driver.py"."""
    # In an identifier, a class, a text.
    return filled("device", {"_gadget": f"_{plain(name)}", "Gadget": class_name(name), "gadget": name})


def filled(folder: str, words: dict[str, str]) -> dict[str, str]:
    """The files of a folder of patterns beside this module, text by path, in other words: the first that fits."""
    pattern = re.compile("|".join(map(re.escape, words)))

    def in_words(text: str) -> str:
        return pattern.sub(lambda found: words[found[0]], text)

    patterns = _templates(resources.files("srl.commissioning.cli") / folder, PurePosixPath())
    return {in_words(str(path).removesuffix(".txt")): in_words(text) for path, text in patterns}


def module(name: str) -> str:
    """The package's name for `import`."""
    return f"srl_{plain(name)}"


def check_name(name: str) -> None:
    """Raises RequestError if a device can't have this name, or another has it."""
    if not re.fullmatch(NAME, name) or len(name) > LONGEST:
        proposed = re.sub(r"[^a-z0-9]+", "-", name.lower()).strip("-0123456789")[:LONGEST].strip("-") or "force-plate"
        problem = f"'{name}' is no device's name: at most {LONGEST} lower-case letters and digits, with - or _ between"
        raise RequestError("NAME", problem, f"For example {proposed}")
    for group in ("drivers", "fakes", "twins"):
        for other in registry.names(group):
            if plain(other) == plain(name):
                problem = f"there is a device '{other}' already, and a profile couldn't tell them apart"
                raise RequestError("NAME", problem, f"Choose another, such as my-{name}; `srl list` shows all")
    made = class_name(name)
    if taken := sorted({made, f"{made}Config", f"{made}Twin", f"Fake{made}"} & imported("device")):
        problem = f"its class would be called '{taken[0]}', and srl has one of that name"
        raise RequestError("NAME", problem, f"Choose another, such as my-{name}")
    if len(package(name)) < len(package("gadget")):
        raise RequestError(
            "NAME", f"'{name}' is the name of another file of the package", f"Choose another, such as my-{name}"
        )
    if importlib.util.find_spec(module(name)) is not None:
        problem = f"there is a package '{module(name)}' in this environment already"
        raise RequestError("NAME", problem, "Choose another name, or uninstall that package")


def imported(folder: str) -> set[str]:
    """The names that the modules of a folder of patterns import, which none of its classes may have."""
    found: set[str] = set()
    for path, text in _templates(resources.files("srl.commissioning.cli") / folder, PurePosixPath()):
        if path.name.endswith(".py.txt"):
            imports = (node for node in ast.walk(ast.parse(text)) if isinstance(node, ast.Import | ast.ImportFrom))
            found |= {name.name for node in imports for name in node.names}
    return found


def plain(name: str) -> str:
    """The name as a module's."""
    return name.replace("-", "_")


def class_name(name: str) -> str:
    """The name as a class's."""
    return "".join(word.capitalize() for word in re.split("[-_]", name))


def _templates(folder: Traversable, path: PurePosixPath) -> Iterator[tuple[PurePosixPath, str]]:
    for entry in folder.iterdir():
        if entry.is_dir():
            yield from _templates(entry, path / entry.name)
        elif entry.name.endswith(".txt"):
            yield path / entry.name, entry.read_text(encoding="utf-8")


def _check_target(target: Path) -> None:
    if target.is_dir() and not target.is_symlink() and not any(target.iterdir()):
        return
    if os.path.lexists(target):
        raise RequestError(str(target), "there is something already", "Choose another folder with -o DIR")
    if not target.absolute().parent.is_dir():
        raise RequestError(
            str(target.absolute().parent), "there is no such folder", "Make it, or choose another with -o DIR"
        )


def _write_whole(target: Path, files: dict[str, str]) -> None:
    """Writes all files or none: under another name first."""
    scratch = None
    try:
        scratch = Path(tempfile.mkdtemp(prefix=f".{target.name}.", dir=target.absolute().parent))
        for name, text in files.items():
            path = scratch / name
            path.parent.mkdir(parents=True, exist_ok=True)
            path.write_text(text, encoding="utf-8")
        if target.is_dir():  # it stays the folder that it is: a shell may stand in it
            for entry in scratch.iterdir():
                entry.rename(target / entry.name)
            return
        mask = os.umask(0)
        os.umask(mask)
        scratch.chmod(0o777 & ~mask)  # as `mkdir` would have made it
        scratch.rename(target)
    except OSError as reason:
        problem = f"it can't be written: {reason.strerror}"
        raise RequestError(str(target), problem, "Choose another folder with -o DIR") from None
    finally:
        if scratch is not None:
            shutil.rmtree(scratch, ignore_errors=True)
