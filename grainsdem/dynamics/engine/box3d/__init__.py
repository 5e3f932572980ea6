"""Box3D behind the contract of an engine: beds of many grains in containers that do not move.

Box3D is Erin Catto's solver for rigid bodies (MIT); Robox3D packs it for Python. It works in single precision, with
hard contacts that are solved anew in every part of a step. Grains are hulls or spheres, a contact has four points at
most, and what was solved before is not part of a state: a run that goes on from one goes on alike, but not to the bit.
"""

from grainsdem.dynamics.engine.box3d.engine import Box3dEngine, load

__all__ = ["Box3dEngine", "load"]
