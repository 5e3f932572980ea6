"""What moves the grains: the contract that an engine keeps, the engines, and the apparatus built around a bed."""

from grainsdem.dynamics.engine.apparatus import Apparatus
from grainsdem.dynamics.engine.choice import EngineName, choose_engine, load
from grainsdem.dynamics.engine.contract import Contacts, Engine, EngineError, Motion

__all__ = ["Apparatus", "Contacts", "Engine", "EngineError", "EngineName", "Motion", "choose_engine", "load"]
