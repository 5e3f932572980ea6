"""A strict reader of worlds in SDFormat 1.9: it holds what `exporters.dem.sdf` writes to the rules of the format."""

import xml.etree.ElementTree as ET
from typing import NamedTuple

import numpy as np


class Rule(NamedTuple):
    """What an element may have: attributes, children with how often ("0", "1", "*", "+"), or a value of a type."""

    attributes: tuple[str, ...] = ()
    children: dict[str, str] = {}  # noqa: RUF012  (never changed)
    value: str | None = None


NAMED = ("name",)
VECTOR, POSE, NUMBER = Rule(value="vector3"), Rule(value="pose"), Rule(value="double")
FLAG, COLOUR, TEXT = Rule(value="bool"), Rule(value="color"), Rule(value="string")
INERTIA = ("ixx", "iyy", "izz", "ixy", "ixz", "iyz")

RULES = {
    "sdf": Rule(("version",), {"world": "*"}),
    "world": Rule(NAMED, {"gravity": "1", "physics": "1", "model": "*"}),
    "gravity": VECTOR,
    "physics": Rule(("name", "type"), {"max_step_size": "1", "real_time_factor": "1"}),
    "max_step_size": NUMBER,
    "real_time_factor": NUMBER,
    "model": Rule(NAMED, {"static": "0", "pose": "0", "link": "*"}),
    "static": FLAG,
    "pose": POSE,
    "link": Rule(NAMED, {"pose": "0", "inertial": "0", "collision": "*", "visual": "*"}),
    "inertial": Rule((), {"pose": "0", "mass": "0", "inertia": "0"}),
    "mass": NUMBER,
    "inertia": Rule((), dict.fromkeys(INERTIA, "1")),
    **dict.fromkeys(INERTIA, NUMBER),
    "collision": Rule(NAMED, {"pose": "0", "geometry": "1", "surface": "0"}),
    "visual": Rule(NAMED, {"pose": "0", "geometry": "1", "material": "0"}),
    "geometry": Rule((), {"box": "0", "mesh": "0"}),
    "box": Rule((), {"size": "1"}),
    "size": VECTOR,
    "mesh": Rule((), {"uri": "1"}),
    "uri": TEXT,
    "surface": Rule((), {"friction": "0"}),
    "friction": Rule((), {"ode": "0"}),
    "ode": Rule((), {"mu": "0", "mu2": "0"}),
    "mu": NUMBER,
    "mu2": NUMBER,
    "material": Rule((), {"ambient": "0", "diffuse": "0"}),
    "ambient": COLOUR,
    "diffuse": COLOUR,
}
"""The part of the specification that we write; the order of children does not matter."""

COUNTS = {"vector3": 3, "pose": 6, "double": 1, "color": 4}


def read_world(path):
    """Return the models of a world by name, as elements, each checked for the rules of the format."""
    root = ET.fromstring(path.read_bytes())  # noqa: S314  (our own file)
    check(root, "sdf")
    assert root.get("version") == "1.9"
    [world] = root
    models = [element for element in world if element.tag == "model"]
    for element in root.iter():
        if element.tag in ("world", "model", "link"):
            # The frames of models, links and joints, and the collisions and visuals of a link, have names of their own.
            for kind in ({"model", "link"}, {"collision"}, {"visual"}):
                names = [child.get("name") for child in element if child.tag in kind]
                assert len(names) == len(set(names)), f"two have one name in {element.get('name')}"
    for model in models:
        check_model(model, path.parent)
    return {model.get("name"): model for model in models}


def check(element, tag):
    """Assert that an element has the attributes, children and value that it may have, and those that it must."""
    rule = RULES[tag]
    assert element.tag == tag
    assert set(element.attrib) == set(rule.attributes), f"{tag} has {sorted(element.attrib)}"
    if "name" in rule.attributes:
        name = element.get("name")
        assert name, "a name is not empty"
        assert name != "world", "a reserved name"
        assert not (name.startswith("__") and name.endswith("__")), "a reserved name"
        assert "::" not in name, "a name holds no scope"
    if rule.value is not None:
        check_value(element, rule.value)
        return
    assert not (element.text or "").strip(), f"{tag} holds text"
    # What has a namespace is for other programs.
    own = [child for child in element if not child.tag.startswith("{")]
    for child in own:
        assert child.tag in rule.children, f"{tag} has no {child.tag}"
        check(child, child.tag)
    for name, often in rule.children.items():
        count = sum(child.tag == name for child in own)
        assert count >= (often in ("1", "+")), f"{tag} needs {name}"
        assert count <= 1 or often in ("*", "+"), f"{tag} has {name} twice"


def check_value(element, kind):
    """Assert that the text of an element is a value of a type."""
    assert not len(element)
    if kind == "string":
        assert element.text.strip() == element.text != ""
    elif kind == "bool":
        assert element.text in ("0", "1", "true", "false")
    else:
        numbers = np.array(element.text.split(), float)
        assert numbers.shape == (COUNTS[kind],), f"{element.tag} has {len(numbers)} numbers"
        assert np.isfinite(numbers).all()
        assert kind != "color" or (numbers.min() >= 0 and numbers.max() <= 1)


def check_model(model, folder):
    """Assert what makes a model a body: a mass and moments that it can have, sizes above zero, meshes that exist."""
    [link] = model.findall("link")
    if model.findtext("static") not in ("1", "true"):
        assert float(link.findtext("inertial/mass")) > 0
        ixx, iyy, izz, ixy, ixz, iyz = (float(link.findtext(f"inertial/inertia/{name}")) for name in INERTIA)
        moments = np.linalg.eigvalsh([[ixx, ixy, ixz], [ixy, iyy, iyz], [ixz, iyz, izz]])
        assert moments[0] > 0, "positive definite"
        assert moments[2] <= moments[:2].sum() * (1 + 1e-9), "no moment is larger than the others' sum"
    assert link.findall("collision")
    for geometry in link.iter("geometry"):
        [shape] = (child for child in geometry if not child.tag.startswith("{"))
        if shape.tag == "box":
            assert min(map(float, shape.findtext("size").split())) > 0
        else:
            uri = shape.findtext("uri")
            assert ":" not in uri
            assert not uri.startswith("/")
            assert ".." not in uri.split("/")
            assert (folder / uri).is_file(), "a mesh is a file beside the world"
            assert (folder / uri).read_bytes().startswith(b"v ")
    assert all(float(element.text) >= 0 for name in ("mu", "mu2") for element in link.iter(name))
