"""Names of signals as people read them, for pictures."""

from __future__ import annotations

from srl.runtime.ipc.layout import Layout


def said(layout: Layout, name: str) -> str:
    """A signal's name in words: "skeleton (mapping)"; of the simulated world "arm tip, as simulated". Others stay.

    `name` may be that of a command without its `_command`, and a plot's title, "arm.position (simulated)".
    """
    signal, mark, note = name.removesuffix(")").partition(" (")
    if mark and (words := said(layout, signal)) != signal:
        return f"{words}, {note}"
    if name not in layout.fields and f"{name}_command" not in layout.fields:
        return name.replace("_", " ") if name in layout.devices else name
    owner, _, rest = name.partition(".")
    words = rest.replace("_", " ").replace(".", " ").strip() or owner
    return f"{words}, as simulated" if owner == "world" else f"{words} ({owner.replace('_', ' ')})"
