"""A skeleton's nodes: names, parents and places at rest."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass
from functools import cached_property

import numpy as np

from srl.runtime.contracts.signals import Array


@dataclass(frozen=True)
class Node:
    """One node.

    Attributes:
        parent: its parent's name; empty for the root.
        offset: (3,) m in the parent's frame, with all rotations zero.
        end: it ends a branch and has no rotation of its own (an end site).
    """

    name: str
    parent: str
    offset: tuple[float, float, float]
    end: bool = False


class Tree:
    """Nodes in depth-first order: each comes before all that hangs on it, and what hangs on it follows it at once.

    Attributes:
        nodes, names: (n) in order.
        parents: (n,) indices, -1 for the root.
        offsets: (n, 3) m.
        joints: indices of the nodes that are no end sites, in order.
    """

    def __init__(self, nodes: Iterable[Node]) -> None:
        """
        Raises:
            ValueError: a name is there twice, a parent is missing, or the order isn't depth-first.
        """
        self.nodes = tuple(nodes)
        self.names = tuple(node.name for node in self.nodes)
        self._index = {name: i for i, name in enumerate(self.names)}
        if len(self._index) < len(self.nodes):
            twice = next(name for name in self.names if self.names.count(name) > 1)
            raise ValueError(f"two nodes are called '{twice}'")
        self.parents = tuple(self._parent(i, node) for i, node in enumerate(self.nodes))
        self.offsets: Array = np.array([node.offset for node in self.nodes])
        self.offsets.flags.writeable = False
        self.joints = tuple(i for i, node in enumerate(self.nodes) if not node.end)

    def _parent(self, i: int, node: Node) -> int:
        if not node.parent:
            if i:
                raise ValueError(f"'{node.name}' is a second root")
            return -1
        above = self._index.get(node.parent, len(self.nodes))
        if above >= i:
            raise ValueError(f"'{node.name}' comes before its parent '{node.parent}'")
        if self.nodes[above].end:
            raise ValueError(f"'{node.name}' hangs on '{node.parent}', which ends a branch")
        at = i - 1  # up from the node before, the parent must be met
        while at != above:
            if at < 0:
                raise ValueError(f"'{node.name}' doesn't follow the branch of its parent '{node.parent}'")
            at = self._index.get(self.nodes[at].parent, -1)
        return above

    def __len__(self) -> int:
        return len(self.nodes)

    def index(self, name: str) -> int:
        """The number of a node. Raises KeyError."""
        return self._index[name]

    def children(self, index: int) -> tuple[int, ...]:
        """The nodes that hang on a node."""
        return tuple(i for i, up in enumerate(self.parents) if up == index)

    @property
    def segments(self) -> tuple[tuple[int, int], ...]:
        """(parent, child) of each of the n - 1 line segments."""
        return tuple((up, i) for i, up in enumerate(self.parents) if up >= 0)

    @cached_property
    def polylines(self) -> tuple[tuple[int, ...], ...]:
        """Paths that cover every segment once, each from the end of a branch up to a node that is already drawn.

        The deepest end comes first: so the body's segments are those of its own branches, and not of an arm's on it.
        """
        drawn, lines = {0}, []
        depth = [0] * len(self)
        for i, parent in enumerate(self.parents[1:], 1):
            depth[i] = depth[parent] + 1
        for tip in sorted(set(range(len(self))) - set(self.parents), key=lambda i: -depth[i]):
            line = [tip]
            while line[-1] not in drawn:
                drawn.add(line[-1])
                line.append(self.parents[line[-1]])
            lines.append(tuple(line))
        return tuple(lines)

    def with_branch(self, parent: str, branch: Iterable[Node]) -> Tree:
        """The tree with nodes inserted right behind `parent`, before all that hangs there. Raises KeyError."""
        at = self.index(parent) + 1
        return Tree((*self.nodes[:at], *branch, *self.nodes[at:]))
