"""The licences of what is installed with srl-runtime, without what is for development: `python -m bench.licences`.

Each package says its own, in the metadata of its wheel. A licence of strong copyleft (GPL, AGPL)
is an error, exit code 1. The LGPL of a library that is imported as it is isn't one.
"""

from __future__ import annotations

import re
import sys
from collections.abc import Iterator
from importlib.metadata import Distribution, PackageNotFoundError, distribution

from packaging.requirements import Requirement
from packaging.utils import canonicalize_name

DEVELOPMENT = ("dev", "docs")
_LESSER = re.compile(r"LGPL[\w.-]*|Lesser General Public License[^,;]*", re.IGNORECASE)
_GPL = re.compile(r"GPL|General Public License", re.IGNORECASE)


def needed(name: str, extras: tuple[str, ...], seen: set[str]) -> Iterator[Distribution]:
    """A package and all that it needs with these extras, each once; what isn't installed is left out."""
    name = canonicalize_name(name)
    if (key := f"{name}{sorted(extras)}") in seen:
        return
    seen.add(key)
    try:
        found = distribution(name)
    except PackageNotFoundError:
        return
    yield found
    for text in found.requires or ():
        requirement = Requirement(text)
        marker = requirement.marker
        if marker is None or any(marker.evaluate({"extra": extra}) for extra in (*extras, "")):
            yield from needed(requirement.name, tuple(requirement.extras), seen)


def licence(package: Distribution) -> str:
    """What a package says of its licence, in a line."""
    terms = _metadata(package, "License-Expression")
    if not terms:
        classified = [
            c.rpartition(" :: ")[2] for c in package.metadata.get_all("Classifier") or () if c.startswith("License ::")
        ]
        terms = ", ".join(c for c in classified if c != "OSI Approved")
    if not terms:
        terms = _metadata(package, "License")
    return terms or "not said"


def _metadata(package: Distribution, key: str) -> str:
    return next(iter(package.metadata.get_all(key) or ()), "").strip().partition("\n")[0]


def licences(of_development: bool = False) -> dict[str, str]:
    """The licence of each package that comes with srl-runtime and its extras, by name."""
    extras = [e for e in distribution("srl-runtime").metadata.get_all("Provides-Extra") or ()]
    chosen = tuple(e for e in extras if of_development or e not in DEVELOPMENT)
    packages = {d.metadata["Name"]: licence(d) for d in needed("srl-runtime", chosen, set())}
    return dict(sorted(packages.items(), key=lambda item: item[0].lower()))


def strong_copyleft(found: dict[str, str]) -> list[str]:
    """Packages whose licence would extend to what is shipped with them: the GPL and the AGPL, not the LGPL."""
    return [name for name, terms in found.items() if _GPL.search(_LESSER.sub("", terms))]


def main() -> int:
    found = licences()
    for name, terms in found.items():
        print(f"{name:28} {terms}")
    wrong = strong_copyleft(found)
    if wrong:
        print(f"licences of the GPL's kind, which only development may need: {', '.join(wrong)}", file=sys.stderr)
    everything = licences(of_development=True)
    only = [name for name in strong_copyleft(everything) if name not in found]
    print("\nof development alone:", ", ".join(f"{name} ({everything[name]})" for name in only) or "none")
    return 1 if wrong else 0


if __name__ == "__main__":
    sys.exit(main())
