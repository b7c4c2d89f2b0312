"""The stages by which a pose is recovered, each on as much of the signal as it needs."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from waveformer.simulator.aperture_grid import ApertureGrid
from waveformer.simulator.aperture_power import AperturePower
from waveformer.simulator.arguments import constant, coordinates, instance, samples, triangles
from waveformer.simulator.errors import RadarError
from waveformer.simulator.mesh import load_mesh
from waveformer.simulator.placement import place_target
from waveformer.simulator.pose_descent import Comparison, FreeGains, descend
from waveformer.simulator.pose_search import search
from waveformer.simulator.radar import SPEED_OF_LIGHT_M_PER_S, Aperture, Chirp
from waveformer.simulator.rigid_pose import RigidPose
from waveformer.simulator.runtime import activate
from waveformer.simulator.target import Target

# Antennas along an axis and frequencies: of the search, of the steps after it, of the whole signal.
_SEARCH_GRID, _STEP_GRID, _SIGNAL_GRID = (20, 2), (30, 4), (20, 4)
_LEAST_ANTENNAS = 8
# (spacing in wavelengths, least cosine) of the samples: echoes off the line of sight miss the aperture.
_SEARCH_SAMPLES, _STEP_SAMPLES = (1.0, 0.8), (0.75, 0.3)
# (antennas along a sub-aperture, hop)
_SEARCH_POWER, _STEP_POWER = (4, 2), (6, 3)
_TILES_PER_AXIS = (5, 1)
# A run that explains less than half of the power is in a wrong valley.
ACCEPTED_MISFIT = 0.5


@dataclass(frozen=True, eq=False)
class Reached:
    """Where a stage ended.

    Attributes:
        stage: its name.
        pose: there.
        misfit: squared residual of this stage over the measured square.
    """

    stage: str
    pose: RigidPose
    misfit: float


@dataclass(frozen=True, eq=False)
class _Thinned:
    """A part of the measured signal: every n-th antenna, a few frequencies."""

    grid: ApertureGrid
    tx_m: NDArray[np.float64]
    nodes: Chirp
    h: NDArray[np.complex128]

    def power(self, size: int, hop: int) -> AperturePower:
        return AperturePower(self.h.reshape(*self.grid.rows.shape, -1), size, hop)


class PoseStages:
    """The stages of a recovery for one measured signal.

    Args:
        h: raw signal (N, T).
        body: the object.
        chirp, tx_m: the radar.
        start: first guess.
    """

    def __init__(
        self, h: NDArray[Any], body: Any, chirp: Chirp, tx_m: NDArray[np.float64], start: RigidPose
    ) -> None:
        self._h, self._body, self._chirp, self._tx_m, self._start = h, body, chirp, tx_m, start
        self._grid = ApertureGrid.find(tx_m, _LEAST_ANTENNAS)
        self._view_m = tx_m.mean(axis=0)
        self._search, self._steps, self._signal = (
            self._thinned(*size) for size in (_SEARCH_GRID, _STEP_GRID, _SIGNAL_GRID)
        )

    @classmethod
    def of(cls, h: Any, vertices: Any, faces: Any, chirp: Chirp, tx_m: Any, start_pose: Any) -> PoseStages:
        """Checks all arguments but those of the search."""
        import trimesh

        instance("chirp", chirp, Chirp)
        aperture = Aperture(coordinates("tx_m", constant("tx_m", tx_m)))
        signal = samples("h", h, (len(aperture), chirp.num_samples))
        corners = triangles(vertices, faces)
        activate()
        from waveformer.simulator.pose_body import Body

        mesh = load_mesh(trimesh.Trimesh(*corners, process=False))
        place_target(Target(mesh, pose=start_pose), None, chirp, aperture)
        body = Body(mesh, SPEED_OF_LIGHT_M_PER_S / chirp.center_hz)
        return cls(signal, body, chirp, aperture.tx_m, RigidPose.of(start_pose, body.middle_m))

    @property
    def middle_m(self) -> NDArray[np.float64]:
        """The object's middle in mesh coordinates, shape (3,)."""
        return np.asarray(self._body.middle_m)

    def run(self, deviations: NDArray[np.float64], rng: np.random.Generator) -> list[Reached]:
        """One search and the steps after it: the poses on its way, the last one with free gains everywhere."""
        from waveformer.simulator.pose_kernel import pose_echoes

        power = self._search.power(*_SEARCH_POWER)
        lit = self._body.lit(self._start, self._view_m, *_SEARCH_SAMPLES)

        def misfits(poses: list[RigidPose]) -> NDArray[np.float64]:
            return power.misfits(pose_echoes(lit, poses, self._search.tx_m, self._search.nodes))

        candidates = search(misfits, self._start, deviations, rng)
        ways: list[list[Reached]] = []
        for candidate in candidates:
            way = [Reached("search", candidate, float(misfits([candidate])[0]))]
            lit_there = self._body.lit(candidate, self._view_m, *_STEP_SAMPLES)
            way.append(
                self._descend(
                    "power", lit_there, way[-1].pose, self._steps, self._steps.power(*_STEP_POWER), 5
                )
            )
            for tiles in _TILES_PER_AXIS:
                gains = FreeGains(self._steps.h, self._steps.grid.tile_labels(tiles))
                name = f"{tiles} x {tiles} free gains"
                way.append(self._descend(name, lit_there, way[-1].pose, self._steps, gains, 8))
            ways.append(way)
            if way[-1].misfit < ACCEPTED_MISFIT:
                break
        return min(ways, key=lambda way: way[-1].misfit)

    def with_phase(self, pose: RigidPose) -> Reached:
        """The best coherent minimum at this pose or half a wavelength before or behind it."""
        lit = self._body.lit(pose, self._view_m, *_STEP_SAMPLES)
        sight = pose.center_m - self._view_m
        half_wave = 0.5 * SPEED_OF_LIGHT_M_PER_S / self._chirp.center_hz * sight / np.linalg.norm(sight)
        whole = FreeGains(self._signal.h, None)
        reached = (
            self._descend("phase", lit, pose.moved([*(turns * half_wave), 0, 0, 0]), self._signal, whole, 5)
            for turns in (0, -1, 1)
        )
        return min(reached, key=lambda at: at.misfit)

    def refined(self, pose: RigidPose) -> Reached:
        """The coherent minimum of the differentiable model."""
        from waveformer.simulator.pose_refinement import refine

        rows = self._signal.grid.rows.ravel()
        found, misfit = refine(self._body, pose, self._h[rows], self._chirp, self._tx_m[rows])
        return Reached("differentiable model", found, misfit)

    def _descend(
        self, stage: str, lit: Any, start: RigidPose, part: _Thinned, comparison: Comparison, max_steps: int
    ) -> Reached:
        from waveformer.simulator.pose_kernel import pose_derivatives

        pose, misfit = descend(
            lambda pose: comparison.linearise(*pose_derivatives(lit, pose, part.tx_m, part.nodes)),
            start,
            max_steps,
        )
        return Reached(stage, pose, misfit)

    def _thinned(self, per_axis: int, num_nodes: int) -> _Thinned:
        grid = self._grid.thinned(per_axis)
        rows = grid.rows.ravel()
        range_m = float(np.linalg.norm(self._start.center_m - self._view_m))
        nodes, h = averaged_frequencies(self._h[rows], self._chirp, num_nodes, range_m)
        return _Thinned(grid, self._tx_m[rows], nodes, h)


def averaged_frequencies(
    h: NDArray[Any], chirp: Chirp, num_nodes: int, range_m: float
) -> tuple[Chirp, NDArray[np.complex128]]:
    """A few frequencies that stand for all: means over runs of samples, turned as if all came from one range.

    Args:
        h: signal (N, T).
        chirp: T samples.
        num_nodes: M, at most T.
        range_m: of the object's middle.

    Returns:
        The M frequencies as a chirp, and the signal there (N, M). Echoes from much nearer or farther are weakened.

    Raises:
        RadarError: there are fewer samples than nodes.
    """
    length = chirp.num_samples // num_nodes
    if length < 1:
        raise RadarError(f"the chirp must have at least {num_nodes} samples, got {chirp.num_samples}")
    used = chirp.frequencies_hz[: num_nodes * length]
    middles = used.reshape(num_nodes, length).mean(axis=1)
    nodes = Chirp(float(middles[0]), float(middles[1] - middles[0]) * num_nodes, num_nodes)
    turn = 4j * np.pi * range_m / SPEED_OF_LIGHT_M_PER_S
    still = h[:, : len(used)] * np.exp(turn * used)
    means = still.reshape(len(h), num_nodes, length).mean(axis=2)
    return nodes, means * np.exp(-turn * nodes.frequencies_hz)
