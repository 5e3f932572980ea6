"""Apparatus around a bed: walls that move, lids, plates of glued grains, added to the text that the exporter wrote."""

from __future__ import annotations

from typing import TYPE_CHECKING
from xml.etree import ElementTree as ET

import numpy as np

from grainsdem.errors import InputError

if TYPE_CHECKING:
    from collections.abc import Iterable, Mapping

    from numpy.typing import ArrayLike

    Element = ET.Element

_GRAINS, _LOOSE = "1", "3"
"""Bits of collisions. Grains and the container have the first bit, the apparatus the second, and grains answer to both:
parts of the apparatus pass through each other and through the container."""

_GRAIN_INERTIA = 0.29
"""Mean of the mass and the moments of inertia of a sphere of unit diameter and density."""

_PART = {"contype": "2", "conaffinity": "0"}

_SOLID = {"contype": "2", "conaffinity": _GRAINS}
"""What is not to pass through the container either."""


class Apparatus:
    """A model's text that parts can be added to, before the grains: a part that many touch comes first in the matrices.

    Parameters
    ----------
    text : str
        What `exporters.mjcf.text` wrote.
    """

    def __init__(self, text: str) -> None:
        self._root = ET.fromstring(text)  # noqa: S314  (our own exporter's text)
        self._world = _find(self._root, "worldbody")
        self._grains = {body.attrib["name"]: body for body in self._world.findall("body") if _is_grain(body)}
        priorities = [int(_find(body, "geom").get("priority", "0")) for body in self._grains.values()]
        self._above_grains = 1 + max(priorities, default=0)
        defaults = _find(self._root, "default")
        for kind in defaults.findall("default"):
            if kind.get("class") == "grain":
                grain = _find(kind, "geom")
                grain.set("conaffinity", _LOOSE)
                # What is added is of no class, and its contacts are as stiff as those of grains.
                stiffness = {key: grain.attrib[key] for key in ("solref", "solimp")}
                defaults.insert(0, ET.Element("geom", stiffness))

    def text(self) -> str:
        """Return the text with what was added."""
        # The tolerance of the solver is relative to the mean inertia: that of grains, however heavy the parts.
        _find(self._root, "statistic").set("meaninertia", _numbers(_GRAIN_INERTIA))
        return ET.tostring(self._root, encoding="unicode")

    def make_spheres(self, radii: ArrayLike, moments: ArrayLike) -> None:
        """Replace every grain by a sphere of the same mass: radii [d] and moments of inertia, shape (n,)."""
        assets = _find(self._root, "asset")
        for mesh in assets.findall("mesh"):
            if mesh.get("name") in self._grains:
                assets.remove(mesh)
        numbers = np.column_stack([radii, moments]).tolist()
        for body, (radius, moment) in zip(self._grains.values(), numbers, strict=True):
            inertial, shape = _find(body, "inertial"), _find(body, "geom")
            inertial.attrib.update(pos="0 0 0", quat="1 0 0 0", diaginertia=_numbers(np.full(3, moment)))
            del shape.attrib["mesh"]
            shape.attrib.update(type="sphere", size=_numbers(radius))

    def set_gravity(self, gravity: ArrayLike) -> None:
        """Set the acceleration, shape (3,)."""
        _find(self._root, "option").set("gravity", _numbers(gravity))

    @property
    def container(self) -> Element | None:
        """Body of the container's walls, for shapes that take the place of one; nothing where there is none.

        Few grains with shapes of the world besides walls are more pairs than MuJoCo keeps room for.
        """
        return next((body for body in self._world.findall("body") if body.get("name") == "container"), None)

    def remove_wall(self, name: str) -> None:
        """Take a wall of the container away, for a part that stands where it stood."""
        for body in self._world.findall("body"):
            for wall in body.findall("geom"):
                if wall.get("name") == name:
                    body.remove(wall)

    def add_body(
        self,
        name: str,
        position: ArrayLike,
        joints: Iterable[tuple[str, str, ArrayLike]],
        *,
        mass: float,
        parent: Element | None = None,
        armatures: Mapping[str, float] | None = None,
    ) -> Element:
        """Add a part that moves along or about its joints (name, ``slide`` or ``hinge``, axis), and return it.

        Its moments of inertia are as large as its mass. A joint's armature is mass, or inertia, that only this joint
        feels: what it drives keeps its speed through a step, and weighs no more.
        """
        body = ET.Element("body", name=name, pos=_numbers(position))
        for joint, kind, axis in joints:
            added = ET.SubElement(body, "joint", name=joint, type=kind, axis=_numbers(axis), limited="false")
            if armatures and joint in armatures:
                added.set("armature", _numbers(armatures[joint]))
        moments = _numbers(np.full(3, mass))
        ET.SubElement(body, "inertial", pos="0 0 0", mass=_numbers(mass), diaginertia=moments)
        if parent is None:
            self._insert(body)
        else:
            parent.append(body)
        return body

    def add_shape(
        self,
        body: Element | None,
        name: str,
        kind: str,
        size: ArrayLike,
        *,
        position: ArrayLike = (0.0, 0.0, 0.0),
        quaternion: ArrayLike = (1.0, 0.0, 0.0, 0.0),
        friction: float | None = 0.0,
        is_solid: bool = False,
    ) -> None:
        """Add a ``box``, a ``sphere`` or a ``cylinder`` of half sizes to a part, or to the world.

        Its friction is that with all grains; None for as among grains that have frictions of their own. Where it
        ``is_solid`` it does not pass through the container.
        """
        place = {"pos": _numbers(position), "quat": _numbers(quaternion)}
        self._add(body, {"name": name, "type": kind, "size": _numbers(size), **place}, friction, is_solid)

    def add_hull(
        self,
        body: Element | None,
        name: str,
        corners: ArrayLike,
        *,
        friction: float | None = 0.0,
        is_solid: bool = False,
    ) -> None:
        """Add the convex hull of corners, shape (n, 3), in the part's frame, to a part or to the world."""
        self.add_mesh(name, corners)
        self._add(body, {"name": name, "type": "mesh", "mesh": name}, friction, is_solid)

    def add_mesh(self, name: str, corners: ArrayLike) -> None:
        """Add corners, shape (n, 3), whose convex hull shapes can be."""
        ET.SubElement(_find(self._root, "asset"), "mesh", name=name, vertex=_numbers(np.ravel(corners)))

    def add_elements(self, elements: Iterable[Element]) -> None:
        """Add bodies, and shapes of the world, as they stand; grains answer to their shapes, and so does the container.

        Shapes without a coefficient of friction of their own have that of the grains.
        """
        for element in elements:
            for shape in element.iter("geom"):
                shape.attrib.update({"material": "wall", "priority": str(self._above_grains), **_SOLID})
            self._insert(element)

    def names(self, tag: str) -> set[str]:
        """Return the names of all elements of a kind, such as ``body``."""
        return {element.attrib["name"] for element in self._root.iter(tag) if "name" in element.attrib}

    def _add(
        self, body: Element | None, attributes: dict[str, str], friction: float | None, is_solid: bool = False
    ) -> None:
        """Add a shape to a part, or to the world."""
        shape = ET.Element("geom", {**attributes, "material": "wall", **(_SOLID if is_solid else _PART)})
        # MuJoCo takes the larger friction of a pair unless one has priority.
        shape.set("priority", "0" if friction is None else str(self._above_grains))
        shape.set("friction", _numbers(friction or 0.0))
        shape.set("condim", "3" if friction else "1")
        if body is None:
            self._insert(shape)
        else:
            body.append(shape)

    def glue(self, grains: Iterable[int], body: Element | None) -> None:
        """Fix grains to a part, or to the world's new part ``floor_grains``, where they are."""
        if body is None:
            body = ET.Element("body", name="floor_grains", pos="0 0 0")
            self._insert(body)
        origin = np.fromstring(body.attrib["pos"], sep=" ")
        for grain in grains:
            element = self._grains[f"g{grain:06d}"]
            self._world.remove(element)
            for joint in (*element.findall("freejoint"), *element.findall("joint")):
                element.remove(joint)
            element.set("pos", _numbers(np.fromstring(element.attrib["pos"], sep=" ") - origin))
            _find(element, "geom").attrib.update(_PART)
            body.append(element)

    def _insert(self, element: Element) -> None:
        """Put an element before the first grain."""
        first = next(i for i, child in enumerate(self._world) if _is_grain(child))
        self._world.insert(first, element)


def _is_grain(element: Element) -> bool:
    return element.tag == "body" and element.get("childclass") == "grain"


def _find(element: Element, tag: str) -> Element:
    found = element.find(tag)
    if found is None:
        raise InputError(f"the model's text has no {tag} element")
    return found


def _numbers(values: ArrayLike) -> str:
    return " ".join(f"{value:.12g}" for value in np.atleast_1d(np.asarray(values, float)))
