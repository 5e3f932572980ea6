"""What moves the grains: the contract that an engine keeps, MuJoCo, and the apparatus built around a bed."""

from grainsdem.dynamics.engine.apparatus import Apparatus
from grainsdem.dynamics.engine.contract import Contacts, Engine, EngineError, Motion
from grainsdem.dynamics.engine.mujoco_engine import MujocoEngine, load

__all__ = ["Apparatus", "Contacts", "Engine", "EngineError", "Motion", "MujocoEngine", "load"]
