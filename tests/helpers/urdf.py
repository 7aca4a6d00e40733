"""A small robot as a URDF: a base below its root, a joint that turns, one that slides, one that follows; a mesh."""

from __future__ import annotations

from pathlib import Path

URDF = """<?xml version="1.0"?>
<robot name="small">
  <link name="root"/>
  <link name="plate"/>
  <link name="arm"><visual><geometry><mesh filename="package://small/arm.stl"/></geometry></visual></link>
  <link name="tool"><visual><geometry><box size="0.1 0.1 0.1"/></geometry></visual></link>
  <link name="clamp"/>
  <joint name="stand" type="fixed"><parent link="root"/><child link="plate"/>
    <origin xyz="0.1 0.2 0.3" rpy="0.3 0.2 3.1415"/></joint>
  <joint name="shoulder" type="revolute"><parent link="plate"/><child link="arm"/>
    <origin xyz="0 0 0.3" rpy="0.5 0 1.0"/><axis xyz="0 1 0"/>
    <limit lower="-3" upper="3" effort="1" velocity="1"/></joint>
  <joint name="slide" type="prismatic"><parent link="arm"/><child link="tool"/>
    <origin xyz="0.2 0 0" rpy="0 1.0 0"/><axis xyz="1 0 2"/>
    <limit lower="-3" upper="3" effort="1" velocity="1"/></joint>
  <joint name="jaw" type="prismatic"><parent link="tool"/><child link="clamp"/><axis xyz="0 1 0"/>
    <mimic joint="slide" multiplier="-0.5" offset="0.01"/>
    <limit lower="-3" upper="3" effort="1" velocity="1"/></joint>
</robot>
"""

STL = """solid t
facet normal 0 0 1
outer loop
vertex 0 0 0
vertex 1 0 0
vertex 0 1 0
endloop
endfacet
endsolid t
"""


def write_urdf(folder: Path, mesh: bool = True, text: str = URDF) -> Path:
    """Writes it, with its mesh or without, and returns the file."""
    file = folder / "small.urdf"
    file.write_text(text)
    if mesh:
        (folder / "small").mkdir(exist_ok=True)
        (folder / "small" / "arm.stl").write_text(STL)
    return file
