"""`srl new NAME --urdf FILE`: a profile for a limb from its URDF, with servos chosen by its weight."""

from __future__ import annotations

import argparse
import shlex
from pathlib import Path

from runtime.cli import new_ports
from runtime.cli.check import examine
from runtime.cli.printable import printable
from runtime.contracts import whole_file
from runtime.contracts.errors import RequestError
from runtime.ipc import older
from runtime.profile.edit import edited
from runtime.profile.from_urdf import Limb


def write(args: argparse.Namespace, target: Path, overrides: list[str]) -> int:
    """Writes the profile, checks it, and says what comes next. Returns 0; what is wrong is raised."""
    file = Path(args.urdf)
    limb = Limb(file, args.base, args.tip, args.driver)
    begun = str(edited(f"{args.name}.yaml", limb.profile(args.name, target.parent), overrides))
    kept = older.keep(target)
    try:
        whole_file.write(target, begun.encode(), RequestError)
        graph, _ = examine(str(target), sim=[])
        real, _ = examine(str(target))
    except BaseException:  # what `--set` says may be wrong; Ctrl-C
        target.unlink(missing_ok=True)
        if kept is not None:
            kept.replace(target)
        raise
    print(f"{target}: made of {file}" + f"; the one before is {kept}" * (kept is not None))
    doubts = [f"doubted: {doubt}" for doubt in (*real.doubts, *graph.doubts)]
    for line in dict.fromkeys([*graph.remarks, *doubts, *limb.strained(), *new_ports.remarks(real)]):
        print(printable(f"  {line}"))
    print("  ids, directions and zeros are guesses: jog each joint of the real limb before anything else")
    print("Next:")
    name = shlex.quote(str(target))
    for line in (f"srl check {name}", f"srl jog {name} --sim", f"srl run {name} --sim --view", f"srl jog {name}"):
        print(f"  {line}")
    return 0
