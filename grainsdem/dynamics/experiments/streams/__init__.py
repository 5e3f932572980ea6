"""Grains that come and go while a run goes: a silo that empties, a container that is filled."""
