"""`srl new law`: writes a control law in a file, a profile that runs it in simulation, and its tests.

The files are those in the folder `law` beside this one, with another name.
"""

from __future__ import annotations

import argparse
import importlib.util
import keyword
import os
import re
import shlex
from pathlib import Path

from srl.commissioning.cli.new_device import LONGEST, NAME, OF_PROFILES, class_name, filled, imported, plain
from srl.commissioning.new.template import check_name as check_profile_name
from srl.runtime.contracts import whole_file
from srl.runtime.contracts.errors import RequestError


def write(args: argparse.Namespace) -> int:
    """Writes the files and says what comes next. Returns 0; what is wrong is raised, and nothing written."""
    for option, typed in OF_PROFILES.items():
        if getattr(args, option):
            raise RequestError(typed, "it is for a profile, and this is a law", "Leave it out")
    name, folder = args.device, args.out or Path()
    check_name(name)
    made = {folder / file: text for file, text in files(name).items()}
    if not folder.is_dir():
        raise RequestError(str(folder), "there is no such folder", "Make it, or choose another with -o DIR")
    for path in made:
        if os.path.lexists(path):
            raise RequestError(str(path), "there is something already", "Choose another name, or a folder with -o DIR")
    _check_module(name)
    written: list[Path] = []
    try:
        for path, text in made.items():
            whole_file.write(path, text.encode(), RequestError)
            written.append(path)
    except BaseException:  # all or none; Ctrl-C
        for path in written:
            path.unlink(missing_ok=True)
        raise
    law, profile, test = (folder / file for file in (f"{plain(name)}.py", f"{name}.yaml", f"test_{plain(name)}.py"))
    print(f"{law}: a law, {class_name(name)}")
    print(f"{profile}: a profile that runs it")
    print(f"{test}: its tests")
    print("Next:")
    file = shlex.quote(str(profile))
    for line in (
        f"srl check {file} --sim", f"srl run {file} --sim --duration 5",
        f"python -m pytest {shlex.quote(str(test))}",
    ):  # fmt: skip
        print(f"  {line}")
    print(f"Then make {law} yours.")
    return 0


def files(name: str) -> dict[str, str]:
    """The text of each file by its name: `follow_hand.py`, `follow-hand.yaml`, `test_follow_hand.py`."""
    own = plain(name)
    words = {"gadget.py": f"{own}.py", "test_gadget": f"test_{own}", "from gadget": f"from {own}"}
    return filled("law", words | {"Gadget": class_name(name), "gadget": name})


def check_name(name: str) -> None:
    """Raises RequestError if no law in a file can have this name."""
    if not re.fullmatch(NAME, name) or len(name) > LONGEST:
        proposed = re.sub(r"[^a-z0-9]+", "-", name.lower()).strip("-0123456789")[:LONGEST].strip("-") or "follow-hand"
        problem = f"'{name}' is no law's name: at most {LONGEST} lower-case letters and digits, with - or _ between"
        raise RequestError("NAME", problem, f"For example {proposed}")
    check_profile_name(name)
    if keyword.iskeyword(plain(name)) or plain(name) == "conftest":
        raise RequestError("NAME", f"no module of Python can be called '{name}'", f"Choose another, such as my-{name}")
    others = imported("law") - {"Gadget", "GadgetConfig"}  # the law itself, of which its tests import both
    if taken := sorted({class_name(name), f"{class_name(name)}Config"} & others):
        problem = f"its class would be called '{taken[0]}', and srl has one of that name"
        raise RequestError("NAME", problem, f"Choose another, such as my-{name}")


def _check_module(name: str) -> None:
    if importlib.util.find_spec(plain(name)) is not None:
        problem = f"there is a module '{plain(name)}' in this environment already, which its tests couldn't tell apart"
        raise RequestError("NAME", problem, f"Choose another, such as my-{name}")
