"""How contacts of MuJoCo are damped for a grain to bounce: from the ratio of its speeds to a ratio of damping.

A contact is a damped spring for the approach of the two that touch, a = −2ζω v − ω² x, whatever their masses, that
pushes and never pulls. Its restitution follows from ζ alone (Schwager & Pöschel 2007, Granular Matter 9, 465). Steps
are not short beside a collision, though: a grain is found overlapping somewhere within a step. What is inverted here is
the mean over all places in the step that MuJoCo takes; a single bounce scatters about it.
"""

from __future__ import annotations

import numpy as np

LEAST, MOST = 0.3, 0.7
"""Restitutions between which spheres that fall from 1 to 10 d bounce to within 0.03 of what was asked for, in the mean.
Below, they lose more than that the slower they are. Above, beds gain energy: the stiffness of MuJoCo's contacts is
relative to what each of them moves, and changes with what else touches and slides while they hold energy."""

DAMPED_STEPS = 2.0
"""Product of the time constant and the ratio of damping of contacts that do not bounce, in time steps: the stiffest
that a step can carry. It is one over the frequency of the spring."""

BOUNCING_STEPS = 4.0
"""The same of those that do. With half as many, single bounces would scatter twice as widely: by up to 0.08."""

DAMPED_START, BOUNCING_START = 0.9, 0.8
"""Share of the spring's acceleration that contacts of either kind have where they just touch: MuJoCo's impedance. With
less, grains lie deeper than they fall in a step: with 0.9 a cube that bounces hops on its corners for ever."""

_PLACES = 64
"""Places in a step at which a grain is found overlapping."""


def mean_restitution(damping: float) -> float:
    """Return the mean speed after a bounce over that before it, of contacts with a ratio of damping.

    Examples
    --------
    >>> round(mean_restitution(0.1), 3), round(mean_restitution(0.3), 3)
    (0.742, 0.441)
    """
    depths, speeds = (np.arange(_PLACES) + 0.5) / _PLACES, np.ones(_PLACES)
    rate = 1.0 / BOUNCING_STEPS
    leaving = np.zeros(_PLACES)
    for _ in range(round(8 * BOUNCING_STEPS)):  # half a turn of the spring is pi of them
        pushes = np.where(depths > 0, np.maximum(2 * damping * rate * speeds + rate**2 * depths, 0.0), 0.0)
        speeds = speeds - pushes
        depths = depths + speeds
        leaving = np.where((depths <= 0) & (leaving == 0), np.maximum(-speeds, 0.0), leaving)
    return float(leaving.mean())


def damping_of(restitution: float) -> float:
    """Return the ratio of damping with which grains bounce by a restitution.

    Examples
    --------
    >>> round(damping_of(0.5), 3)
    0.248
    """
    low, high = 0.0, 1.0
    for _ in range(40):
        middle = 0.5 * (low + high)
        low, high = (middle, high) if mean_restitution(middle) > restitution else (low, middle)
    return 0.5 * (low + high)
