"""Realistic granular material from tessellations, proven free of overlap and handed to physics.

The public names stand in ``__init__.pyi``. Each is imported when it is first used, so that ``import grainsdem`` is
quick and loads none of mujoco, pxr, trimesh or matplotlib.
"""

import lazy_loader

__version__ = "0.1.0"

__getattr__, __dir__, __all__ = lazy_loader.attach_stub(__name__, __file__)
