"""Grains in motion: MuJoCo simulates the very text that `exporters.mjcf` writes, and gives back a packing."""

from grainsdem.dynamics.settle import Progress, Settled, SettleReport, settle

__all__ = ["Progress", "SettleReport", "Settled", "settle"]
