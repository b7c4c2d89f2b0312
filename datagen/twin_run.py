"""Making a twin: every object under every condition, going on where an interrupted run stopped."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, field
from importlib.metadata import version
from pathlib import Path
from typing import Any

from waveformer import __version__
from waveformer.datagen.twin_conditions import CONDITIONS, Condition
from waveformer.datagen.twin_echo import IdealEcho, echo_of_clean, group_by_echo, ideal_echo, record
from waveformer.datagen.twin_objects import TwinObject
from waveformer.datagen.twin_scene import TwinScene, file_sha256
from waveformer.datagen.twin_settings import TwinSettings
from waveformer.datagen.twin_store import (
    begin_root,
    check_root,
    is_finished,
    read_scan,
    sweep,
    write_scan,
)
from waveformer.datagen.twin_workers import default_workers, run_jobs
from waveformer.simulator.errors import MeshError, RadarError
from waveformer.simulator.file_lock import FileLock

_PACKAGES = ("numpy", "mitsuba", "drjit")


@dataclass(frozen=True)
class Failure:
    """A scan that could not be made.

    Attributes:
        object_id, condition: which.
        reason: one line.
    """

    object_id: str
    condition: str
    reason: str


@dataclass
class TwinProgress:
    """How far a run has come, also when it is interrupted.

    Attributes:
        total: scans asked for.
        kept: of these, those that were there before.
        written: made by this run.
        failures: that could not be made.
    """

    total: int = 0
    kept: int = 0
    written: int = 0
    failures: list[Failure] = field(default_factory=list)

    @property
    def done(self) -> int:
        """Scans that are there, or that will not be."""
        return self.kept + self.written + len(self.failures)


@dataclass(frozen=True)
class TwinJob:
    """Scans that share one echo.

    Attributes:
        root: of the twin.
        item: the object.
        conditions: those that are missing, with equal `echo_key`.
        settings: of the twin.
    """

    root: Path
    item: TwinObject
    conditions: tuple[Condition, ...]
    settings: TwinSettings


def run_twin(
    root: Path,
    objects: Sequence[TwinObject],
    conditions: Sequence[Condition],
    settings: TwinSettings,
    *,
    workers: int | None = None,
    progress: Callable[[TwinProgress], None] | None = None,
) -> TwinProgress:
    """Make all scans that are not there yet.

    An object that cannot be simulated is reported, and the others are made.

    Args:
        root: folder of the twin.
        objects, conditions: every pair of them is one scan.
        settings: of the twin.
        workers: processes of one thread each; None as in `twin_workers.default_workers`.
        progress: called with the state of the run at its beginning and after each job.

    Raises:
        RadarError: fewer than one worker.
        StoreError: the folder holds something else or scans of other settings, is in use, or cannot be written.
        SetupError: the ray tracer is missing or broken, or a worker process died.
    """
    if workers is not None and workers < 1:
        raise RadarError(f"workers must be at least 1, got {workers}")
    check_root(root, settings)
    lock = FileLock(root / ".lock")
    try:
        begin_root(root, settings)
        sweep(root)
        state = TwinProgress(total=len(objects) * len(conditions))
        jobs = _missing_jobs(root, objects, conditions, settings, state)
        if progress is not None:
            progress(state)
        for written, failures in run_jobs(run_job, jobs, workers or default_workers()):
            state.written += written
            state.failures += failures
            if progress is not None:
                progress(state)
        return state
    finally:
        lock.release()


def run_job(job: TwinJob) -> tuple[int, list[Failure]]:
    """Make the scans of one job; returns how many, and those that could not be made."""
    try:
        scene = TwinScene.load(job.item, job.settings)
        echo = _stored_echo(job, scene) or ideal_echo(scene, job.conditions[0], job.settings)
    except (MeshError, RadarError) as error:
        return 0, [_failure(job.item, condition, error) for condition in job.conditions]
    for condition in job.conditions:
        identity = scan_identity(job.item, scene.mesh_sha256, condition, job.settings)
        twin = {"condition": condition.name, "reflectivity": scene.reflectivity}
        origin = {"twin": twin, "waveformer_version": __version__}
        measurement = record(scene, echo, condition, job.settings, origin)
        described = {
            **scene.describe(),
            "support_z_m": job.settings.support_z_m,
            "seed": job.settings.seed,
            "front_end_seed": job.settings.front_end_seed(job.item.object_id),
            "echo_seconds": echo.seconds,
            "versions": {"waveformer": __version__, **{name: version(name) for name in _PACKAGES}},
        }
        write_scan(scan_folder(job.root, job.item, condition), measurement, scene.truth, described, identity)
    return len(job.conditions), []


def scan_folder(root: Path, item: TwinObject, condition: Condition) -> Path:
    """Where a scan lies."""
    return root / condition.name / item.object_id


def scan_identity(
    item: TwinObject, mesh_sha256: str, condition: Condition, settings: TwinSettings
) -> dict[str, Any]:
    """All that determines a scan, as JSON values."""
    return {
        "object_id": item.object_id,
        "mesh_sha256": mesh_sha256,
        "condition": condition.describe(settings.chirp.center_hz),
        "settings": settings.describe(),
    }


def _missing_jobs(
    root: Path,
    objects: Sequence[TwinObject],
    conditions: Sequence[Condition],
    settings: TwinSettings,
    state: TwinProgress,
) -> list[TwinJob]:
    """What is left to do; counts in `state` what is there and what has no mesh."""
    jobs = []
    for item in objects:
        try:
            digest = file_sha256(item)
        except MeshError as error:
            state.failures += [_failure(item, condition, error) for condition in conditions]
            continue
        missing = []
        for (
            condition
        ) in CONDITIONS.values():  # those not asked for, too: an object has one mesh in all of them
            identity = scan_identity(item, digest, condition, settings)
            finished = is_finished(scan_folder(root, item, condition), identity)
            if condition in conditions:
                state.kept += finished
                missing += [] if finished else [condition]
        jobs += [TwinJob(root, item, tuple(group), settings) for group in group_by_echo(missing)]
    return jobs


def _stored_echo(job: TwinJob, scene: TwinScene) -> IdealEcho | None:
    """The echo of an earlier run, if this job's is that of a clean scan and there is one."""
    clean = CONDITIONS["clean"]
    folder = scan_folder(job.root, job.item, clean)
    identity = scan_identity(job.item, scene.mesh_sha256, clean, job.settings)
    if job.conditions[0].echo_key != clean.echo_key or not is_finished(folder, identity):
        return None
    return echo_of_clean(read_scan(folder).measurement())


def _failure(item: TwinObject, condition: Condition, error: Exception) -> Failure:
    return Failure(item.object_id, condition.name, str(error))
