"""`srl keys`: certificates for the bus over the network."""

from __future__ import annotations

import argparse
from pathlib import Path

from srl.runtime.cli import add_command
from srl.runtime.contracts.errors import HostError, RequestError
from srl.runtime.profile.keys import ROLES

_DAYS = range(1, 3651)


def add_parser(subparsers: argparse._SubParsersAction[argparse.ArgumentParser]) -> None:
    """Registers the command."""
    parser = add_command(subparsers, "keys", "srl keys ~/srl-keys robot --host robot.lab")
    parser.add_argument("folder", type=Path, help="where the authority's files are; the first call makes them")
    parser.add_argument("name", help="the certificate's common name: of the service, or of a person or program")
    parser.add_argument(
        "--host", action="append", default=[], metavar="HOST",
        help="for the service: a name or address that clients connect to",
    )  # fmt: skip
    parser.add_argument("--role", choices=ROLES, help="for a client: what it may do")
    parser.add_argument("--days", type=int, default=365, metavar="N", help="how long it holds good; default: 365")
    parser.set_defaults(run=run)


def run(args: argparse.Namespace) -> int:
    """Makes the files and says where each belongs. Raises RequestError or HostError."""
    from srl.runtime.bus.certificates import AUTHORITY, authority, sign

    if bool(args.host) == bool(args.role):
        raise RequestError("srl keys", "is it the service's or a client's?", "Give --host, or --role, one of them")
    if args.days not in _DAYS:
        raise RequestError("--days", f"{args.days} isn't from 1 to {_DAYS[-1]}", "Give the number of days")
    folder: Path = args.folder.expanduser().absolute()
    try:
        folder.mkdir(mode=0o700, parents=True, exist_ok=True)
    except OSError as error:
        raise HostError(str(folder), f"it can't be made: {error.strerror}", "Name a folder you may write") from None
    made = authority(folder)
    sign(folder, args.name, args.host, args.days)
    if made:
        print(
            f"{folder}/{AUTHORITY}.pem, {AUTHORITY}.key: a new authority. Its key signs clients: keep it off the robot"
        )
    print(f"{folder}/{args.name}.pem, {args.name}.key: valid {args.days} days")
    if args.host:
        print("In the profile, with the three files copied to the robot:")
        print("  bus:")
        print("    listen: [tls/0.0.0.0:7447]")
        names = f"ca: /etc/srl/{AUTHORITY}.pem, certificate: /etc/srl/{args.name}.pem, key: /etc/srl/{args.name}.key"
        print(f"    tls: {{{names}}}")
        print("    roles: {operator: [], observer: []}   # the names of those who may connect")
        print("For a ROS 2 router instead: srl check PROFILE --router FILE (docs/ros2.md)")
    else:
        print(f"Give {AUTHORITY}.pem and these two to {args.name}. In the profile:")
        print("  bus:")
        print(f"    roles: {{{args.role}: [{args.name}]}}")
    return 0
