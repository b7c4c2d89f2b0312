"""The differentiable model: forward and adjoint together, plain reverse mode beside it, and memory over the pairs."""

from __future__ import annotations

import json
import re
import subprocess
import sys
from dataclasses import replace
from pathlib import Path
from typing import Any

import drjit as dr
import numpy as np
import torch
from numpy.typing import NDArray
from scenes import APERTURE, CHIRP, bumpy_ellipsoid, measure, report

from waveformer.simulator import Aperture
from waveformer.simulator.backend import Array3f, Array4f, Float, UInt32
from waveformer.simulator.device import to_device
from waveformer.simulator.differentiable import freeze, simulate
from waveformer.simulator.echo_terms import echo, leg, phasor
from waveformer.simulator.reference_frozen import samples_of
from waveformer.simulator.tangent_echo import Direction

_FEW_PAIRS, _MANY_PAIRS = 10_000_000, 1_000_000_000
_PLAIN_ANTENNAS = 64


def surface_echo() -> tuple[Any, int]:
    """The echo of the benchmark's object with everything discrete found, and its pairs of sample and antenna."""
    mesh = bumpy_ellipsoid()
    frozen = freeze(mesh.vertices_m, mesh.faces, CHIRP, APERTURE.tx_m)
    target = frozen.targets[0]
    samples = samples_of(target.pieces, frozen.faces, mesh.vertices_m)
    term = target.surface.echo(samples, CHIRP, APERTURE, None, 1j / (4.0 * np.pi))
    seen = sum(
        len(work.tile.rows) * (len(work.members) + len(work.visibility.partial))
        for work in target.surface.tiles
    )
    return term, seen


def plain_reverse_mode(term: Any) -> int:
    """Forward and backward of every pair by Dr.Jit's own reverse mode, for one frequency; returns the pairs."""
    samples = term.plan.samples
    count = len(samples.points_m)
    center = term.plan.ranges.center_m
    antennas = APERTURE.tx_m[:: len(APERTURE) // _PLAIN_ANTENNAS] - center
    table = to_device(
        np.concatenate(
            [samples.points_m - center, samples.normals, samples.areas_m2[:, None], term.plan.taper[:, None]],
            axis=1,
        )
    )
    dr.enable_grad(table)
    lane = dr.arange(UInt32, count * len(antennas))
    row = lane // dr.opaque(UInt32, count)
    sample = lane - row * dr.opaque(UInt32, count)
    head, tail = dr.gather(Array4f, table, 2 * sample), dr.gather(Array4f, table, 2 * sample + 1)
    offset = dr.gather(Array3f, to_device(antennas), row)
    way = leg(offset, dr.norm(offset), Array3f(head.x, head.y, head.z), Array3f(head.w, tail.x, tail.y))
    amplitude, excess, _ = echo(way, None, tail.z, tail.w, False)
    real, imaginary = phasor(excess * dr.opaque(Float, -2.0 / term.plan.ranges.wavelength_m))
    sums = dr.zeros(Float, 2 * len(antennas))
    dr.scatter_reduce(dr.ReduceOp.Add, sums, amplitude * real, 2 * row)
    dr.scatter_reduce(dr.ReduceOp.Add, sums, amplitude * imaginary, 2 * row + 1)
    dr.backward(dr.sum(sums * sums))
    dr.eval(dr.grad(table))
    dr.sync_thread()
    return count * len(antennas)


def peak_bytes(pairs: int) -> dict[str, float]:
    """Peak memory of one forward and backward pass over about so many pairs; run in a process of its own."""
    mesh = bumpy_ellipsoid()
    visible = freeze(mesh.vertices_m, mesh.faces, CHIRP, APERTURE.tx_m[::300]).num_samples
    count = max(1, round(pairs / visible))
    width = int(np.ceil(np.sqrt(count)))
    aperture = Aperture.planar_grid(num_x=width, num_y=width, spacing_m=0.18 / width)
    tx = aperture.tx_m[:count]
    vertices = torch.tensor(mesh.vertices_m, requires_grad=True)
    chirp = replace(CHIRP, num_samples=64)
    h = simulate(vertices, mesh.faces, chirp, tx)
    (h.abs() ** 2).sum().backward()
    # not ru_maxrss, which starts from the peak of the parent; the line reads "VmHWM:   123456 kB"
    (peak,) = re.findall(r"VmHWM:\s*(\d+) kB", Path("/proc/self/status").read_text())
    return {"memory_pairs": visible * count, "memory_bytes": int(peak) * 1024}


def main(quick: bool) -> None:
    term, pairs = surface_echo()
    gradient: NDArray[np.complex64] = term.value()
    runs = 2 if quick else 5
    forward = measure(term.value, runs).rate(pairs)
    both = measure(lambda: (term.value(), term.sample_gradient(gradient)), runs).rate(pairs)
    axes = [Direction(transmitters_m=axis) for axis in np.eye(3)]
    sensors = measure(
        lambda: (term.value(), term.sample_gradient(gradient), *(term.derivative(axis) for axis in axes)), 2
    ).rate(pairs)
    plain_pairs = plain_reverse_mode(term)
    plain = measure(lambda: plain_reverse_mode(term), runs).rate(plain_pairs)
    slower = both["pairs_per_cpu_s"] / plain["pairs_per_cpu_s"]
    rows: list[dict[str, Any]] = [
        {"name": "forward at the tolerance of the differentiable model", **forward},
        {"name": "forward and adjoint", **both},
        {"name": "forward, adjoint and three derivatives by the antennas", **sensors},
        {"name": "forward and backward by plain reverse mode", **plain, "slower_than_kernel": slower},
    ]
    for pairs_asked in (_FEW_PAIRS, _MANY_PAIRS // (10 if quick else 1)):
        done = subprocess.run(
            [sys.executable, __file__, "--memory", str(pairs_asked)],
            stdout=subprocess.PIPE,
            text=True,
            check=True,
        )
        rows.append(json.loads(done.stdout.splitlines()[-1]))
    report(rows)


if __name__ == "__main__":
    if "--memory" in sys.argv:
        print(json.dumps(peak_bytes(int(sys.argv[sys.argv.index("--memory") + 1]))))
    else:
        main("--quick" in sys.argv)
