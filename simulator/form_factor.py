"""The form factor of flat rectangular pieces along the axes, in Dr.Jit."""

from __future__ import annotations

from typing import Any

import drjit as dr
import numpy as np

from waveformer.simulator.backend import Complex2f, Float
from waveformer.simulator.echo_terms import Leg, phasor


def rectangle_form_factor(legs: list[Leg], normal: Any, edges: Any, wavenumber: Any) -> Any:
    """Mean of amplitude and phase over a rectangle along the axes, over their values in the middle.

    Along an axis with phase a over half the edge L, relative slope g of cos / (R_tx R_rx) and curvature
    b = -k sum (1 - u^2) / 2R of both ways, the mean of (1 + g x) exp(j (2 a x / L + b x^2)) is to first order in g and b

        S + j g L / 2 D + j b L^2 / 4 (S (1 - 2 / a^2) + 2 cos(a) / a^2),  S = sin(a) / a,  D = (S - cos(a)) / a,

    and the mixed curvature adds a product of both axes' D. Without these terms pieces as wide as a wavelength make a
    false mirror where the phases of neighbours differ by a turn.
    """
    both = (legs[0], legs[-1])
    factor, slopes, mixed = Complex2f(1.0, 0.0), Complex2f(1.0, 0.0), Float(0.0)
    axes = range(3)
    inside = [1.0 - dr.abs(normal[axis]) for axis in axes]
    for axis in axes:
        edge = edges[axis] * inside[axis]
        half = 0.5 * wavenumber * edge * (both[0].direction[axis] + both[1].direction[axis])
        cosine, sine = phasor(half * (0.5 / np.pi))
        small = dr.abs(half) < 0.2
        square = half * half
        inverse = dr.rcp(dr.select(small, 1.0, half))
        even = dr.select(small, 1.0 - square / 6.0, sine * inverse)
        odd = dr.select(small, half * (1.0 / 3.0 - square / 30.0), (even - cosine) * inverse)
        bent = dr.select(small, 1.0 / 3.0 - square / 10.0, even - 2.0 * odd * inverse)
        sagitta, growth = Float(0.0), Float(0.0)
        for way in both:
            along = way.direction[axis]
            sagitta = sagitta + (1.0 - along * along) * way.inverse_m
            growth = growth + 1.5 * along * way.inverse_m
            others = way.direction[(axis + 1) % 3] * inside[(axis + 1) % 3] * inside[axis]
            mixed = mixed + along * others * way.inverse_m
        imaginary = bent * sagitta * edge * edge * wavenumber * (-0.125) + growth * odd * edge * 0.5
        factor = factor * Complex2f(even, imaginary)
        # along the normal there is no edge
        slopes = slopes * dr.select(
            inside[axis] > 0.5, Complex2f(0.0, 0.5) * (edge * odd), Complex2f(1.0, 0.0)
        )
    return factor + Complex2f(0.0, 1.0) * slopes * (mixed * wavenumber)
