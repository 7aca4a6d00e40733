"""Names of this project that have changed: an old one must not be passed over in silence."""

from __future__ import annotations

from collections.abc import Mapping


def refuse_old_names(made: object, renamed: Mapping[str, str]) -> None:
    """Refuses a class, or an object, that has a method or an attribute by a name of before: nobody would look at it.

    Args:
        made: a driver, law, twin, world or part of a package.
        renamed: the new name by the old one.
    Raises:
        ImportError: it has one.
    """
    for old, new in renamed.items():
        if hasattr(made, old):
            cls = made if isinstance(made, type) else type(made)
            raise ImportError(f"{cls.__module__}.{cls.__qualname__}: its '{old}' is now called '{new}'; rename it")
