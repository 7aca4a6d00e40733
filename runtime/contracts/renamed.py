"""Names of this project that have changed: an old one must not be passed over in silence."""

from __future__ import annotations

from collections.abc import Mapping


def refuse_old_methods(cls: type, renamed: Mapping[str, str]) -> None:
    """Refuses a class that defines a method by a name of before: nobody would call it.

    Args:
        cls: a driver, law or twin of a package.
        renamed: the new name by the old one.
    Raises:
        TypeError: it defines one.
    """
    for old, new in renamed.items():
        if old in vars(cls):
            raise TypeError(f"{cls.__module__}.{cls.__qualname__}: its method '{old}' is now called '{new}'; rename it")
