"""`srl new NAME --from PROFILE --split DEVICE`: writes a profile's two halves, for two computers."""

from __future__ import annotations

import argparse
import shlex
from pathlib import Path

from srl.commissioning.new.split import split
from srl.runtime.contracts import whole_file
from srl.runtime.contracts.errors import RequestError
from srl.runtime.ipc import older
from srl.runtime.profile import library


def write(args: argparse.Namespace) -> int:
    """Writes both files and says what comes next. Returns 0; what is wrong is raised, and nothing written."""
    if args.template is None:
        raise RequestError("--split", "it isn't said of which profile", "Add --from PROFILE, a name or a file")
    for option, given in (("--urdf", args.urdf), ("--port", args.port), ("--out", args.out)):
        if given:
            raise RequestError(option, "both halves are as the whole profile", "Leave it out")
    host = args.host[0] if args.host else None
    made = split(args.template, args.name, args.split, host, args.set)
    # Paths in the halves begin where the whole profile is; a shipped one's begin here.
    folder = Path() if args.template in library.shipped() else made.folder
    targets = {name: folder / f"{name}.yaml" for name in made.texts}
    for target in targets.values():
        older.check(target, "a file", args.yes, f"{target}")
    for name, target in targets.items():
        older.keep(target)
        whole_file.write(target, made.texts[name].encode(), RequestError)
    near, far = (shlex.quote(str(targets[name])) for name in (made.near, made.far))
    where = host or "this computer"
    print(f"{near}: for {where}, which has {', '.join(args.split)}")
    print(f"{far}: for the computer with the limb, in place of {args.template}")
    print("Next:")
    if host is not None:
        hosts = " ".join(f"--host {shlex.quote(each)}" for each in args.host)
        for line in (
            f"srl keys srl-keys {made.near} {hosts}", f"srl keys srl-keys {made.far} --role observer",
            f"# to /etc/srl on {host}: ca.pem, {made.near}.pem, {made.near}.key, {Path(near).name}",
            f"# to /etc/srl at the limb: ca.pem, {made.far}.pem, {made.far}.key, {Path(far).name}",
        ):  # fmt: skip
            print(f"  {line}")
    print(f"  srl run {near}    # on {where}, first")
    print(f"  srl run {far} --set start=manual    # at the limb")
    return 0
