"""Scans a mesh collection into a catalogue: every file is loaded once, in a process it may crash or hang."""

from __future__ import annotations

import dataclasses
import json
import math
import os
import threading
import time
from collections.abc import Callable, Generator, Iterable, Iterator, Sequence
from concurrent.futures import FIRST_COMPLETED, Future, ThreadPoolExecutor, wait
from contextlib import closing, contextmanager
from pathlib import Path
from typing import Any

from waveformer.datagen.catalog import Catalog, CatalogEntry, mark_copies, split_of
from waveformer.datagen.catalog_items import OUTSIDE, CatalogItem, UpAxis, is_inside, printable
from waveformer.datagen.catalog_sources import read_source
from waveformer.datagen.sandbox import Sandbox, SandboxError
from waveformer.simulator.errors import StoreError

MEMORY_LIMIT_BYTES = 3_000_000_000
_PROBE = "waveformer.datagen.catalog_probe:probe_mesh"
_WRONG_SHA256 = (
    "its SHA-256 is not what the collection says: a changed or failed download; get the file again"
)


def scan_catalog(
    root: str | os.PathLike[str],
    source: str,
    *,
    workers: int = 1,
    unit_m: float | None = None,
    up_axis: UpAxis | None = None,
    held_out: Sequence[Catalog] = (),
    time_limit_s: float = 60.0,
    memory_limit_bytes: int = MEMORY_LIMIT_BYTES,
    journal: Path | None = None,
    progress: Callable[[int, int], None] = lambda done, total: None,
) -> Catalog:
    """The catalogue of a folder.

    Args:
        root: the folder.
        source: whose layout it has, a name of `READERS`.
        workers: processes that load meshes.
        unit_m: metres per unit of all files, over what the source says.
        up_axis: of all files, over what the source says.
        held_out: objects of the same shape as one in these catalogues are marked unusable.
        time_limit_s: for loading one file.
        memory_limit_bytes: address space for loading one file, libraries included.
        journal: file that keeps what was learned of each file, so that an interrupted scan goes on from there. It
            stays; files of another size or time are loaded anew.
        progress: called with the files done and their number.

    Raises:
        StoreError: an unknown source, a folder of another layout, a journal that cannot be written, or a number
            that makes no sense.
    """
    if unit_m is not None and not (math.isfinite(unit_m) and unit_m > 0):
        raise StoreError(f"unit_m must be a positive number of metres, got {unit_m}")
    if workers < 1:
        raise StoreError(f"workers must be at least 1, got {workers}")
    folder = Path(root)
    items = [_override(item, unit_m, up_axis) for item in read_source(folder, source)]
    found: list[dict[str, Any]] = [{} for _ in items]
    with _open_journal(journal) as (known, remember):
        jobs = []
        for number, item in enumerate(items):
            if item.reason:
                continue
            key = _key(folder, item)
            if not is_inside(os.path.realpath(folder), folder / item.path):
                found[number] = {"reason": OUTSIDE}
            elif key in known:
                found[number] = known[key]
            else:
                jobs.append((number, item, key))
        done = len(items) - len(jobs)
        progress(done, len(items))
        loader = _Loader(folder, time_limit_s, memory_limit_bytes)
        with closing(loader.run(jobs, workers)) as results:
            for (number, _, key), result in results:
                found[number] = result
                remember(key, result)
                done += 1
                progress(done, len(items))
    entries = (_entry(item, result) for item, result in zip(_unique(items), found, strict=True))
    return Catalog(folder, mark_copies(entries, held_out))


_Job = tuple[int, CatalogItem, str | None]


class _Loader:
    """Loads files in one sandbox a thread, and stops them all when the user says so."""

    def __init__(self, root: Path, time_limit_s: float, memory_limit_bytes: int) -> None:
        self._root = root
        self._time_limit_s = time_limit_s
        self._memory_limit_bytes = memory_limit_bytes
        self._local = threading.local()
        self._boxes: list[Sandbox] = []
        self._stopping = False

    def run(self, jobs: Sequence[_Job], workers: int) -> Generator[tuple[_Job, dict[str, Any]], None, None]:
        """Each job with what was found, as they are ready."""
        waiting = iter(jobs)
        running: dict[Future[dict[str, Any]], _Job] = {}
        pool = ThreadPoolExecutor(workers)
        try:
            while True:
                for job in waiting:
                    running[pool.submit(self._load, job[1])] = job
                    if len(running) >= 2 * workers:
                        break
                if not running:
                    return
                for future in wait(running, return_when=FIRST_COMPLETED).done:
                    yield running.pop(future), future.result()
        finally:
            self._stopping = True
            pool.shutdown(wait=False, cancel_futures=True)
            while not all(future.done() for future in running):
                for box in self._boxes:
                    box.kill()
                time.sleep(0.02)
            pool.shutdown(wait=True)
            for box in self._boxes:
                box.close()

    def _load(self, item: CatalogItem) -> dict[str, Any]:
        if self._stopping:
            return {}
        box: Sandbox | None = getattr(self._local, "box", None)
        if box is None:
            box = self._local.box = Sandbox(
                _PROBE, time_limit_s=self._time_limit_s, memory_limit_bytes=self._memory_limit_bytes
            )
            self._boxes.append(box)
        arguments = (str(self._root / item.path), item.unit_m, item.up_axis)
        for attempt in ("first", "last"):
            try:
                result: dict[str, Any] = box.call(*arguments)
                return result
            except SandboxError as error:
                # Something else may have ended the process, so what dies is tried once more.
                if error.kind != "died" or attempt == "last" or self._stopping:
                    return {"reason": self._explain(item, error)}
        raise AssertionError("unreachable")

    def _explain(self, item: CatalogItem, error: SandboxError) -> str:
        name = item.path.rsplit("/", 1)[-1]
        match error.kind:
            case "timeout":
                return f"{name}: loading takes more than {self._time_limit_s:g} s; simplify the mesh"
            case "memory":
                limit_gb = self._memory_limit_bytes / 1e9
                return f"{name}: loading takes more than {limit_gb:g} GB of memory; simplify the mesh"
            case "died":
                return f"{name}: it crashes the mesh reader ({error}); get or export the file again"
            case _:
                return f"{name}: the mesh reader failed ({error}); get or export the file again"


def _entry(item: CatalogItem, found: dict[str, Any]) -> CatalogEntry:
    reason = item.reason or found.get("reason", "")
    sha256 = found.get("sha256", "")
    if not reason and item.expected_sha256 and sha256 != item.expected_sha256:
        reason = _WRONG_SHA256
    geometry = "" if reason else found["geometry_sha256"]
    return CatalogEntry(
        object_id=f"{item.source}/{item.object_id}",
        source=item.source,
        category=printable(item.category),
        path=item.path,
        sha256=sha256,
        geometry_sha256=geometry,
        faces=found.get("faces", 0),
        watertight=found.get("watertight", False),
        unit_m=item.unit_m,
        up_axis=item.up_axis,
        longest_side_m=math.nan if item.unit_m is None else found.get("longest_side_m", math.nan),
        licence=printable(item.licence),
        split=split_of(geometry),
        problems=(*item.notes, *found.get("problems", ())),
        reason=reason,
    )


def _override(item: CatalogItem, unit_m: float | None, up_axis: UpAxis | None) -> CatalogItem:
    if unit_m is not None:
        item = dataclasses.replace(item, unit_m=unit_m)
    return dataclasses.replace(item, up_axis=up_axis) if up_axis is not None else item


def _unique(items: Iterable[CatalogItem]) -> Iterator[CatalogItem]:
    """Later objects of a name that was there before, renamed and refused."""
    paths: dict[tuple[str, str], str] = {}
    for item in items:
        name, count = printable(item.object_id), 1
        while (item.source, name) in paths:
            count += 1
            name = f"{printable(item.object_id)}#{count}"
        paths[item.source, name] = item.path
        reason = item.reason
        if count > 1 and not reason:
            first = paths[item.source, printable(item.object_id)]
            reason = f"another file has the same object_id: {first}"
        yield dataclasses.replace(item, object_id=name, reason=reason)


def _key(root: Path, item: CatalogItem) -> str | None:
    """What a file was when it was loaded, and how; None if it cannot even be looked at."""
    try:
        status = os.stat(root / item.path)
    except (OSError, ValueError):
        return None
    return json.dumps([item.path, status.st_size, status.st_mtime_ns, item.unit_m, item.up_axis])


@contextmanager
def _open_journal(
    path: Path | None,
) -> Iterator[tuple[dict[str | None, dict[str, Any]], Callable[[str | None, dict[str, Any]], None]]]:
    """What a journal knows, and a function that adds to it; a last line cut off by a crash is passed over."""
    known: dict[str | None, dict[str, Any]] = {}
    if path is None:
        yield known, lambda key, result: None
        return
    try:
        if path.exists():
            for line in path.read_text(encoding="utf-8", errors="replace").splitlines():
                try:
                    key, result = json.loads(line)
                except ValueError:
                    continue
                known[key] = result
        path.parent.mkdir(parents=True, exist_ok=True)
        with path.open("a", encoding="utf-8") as file:
            file.write("\n")  # so that a line cut off does not spoil the next one

            def remember(key: str | None, result: dict[str, Any]) -> None:
                if key is not None:
                    file.write(json.dumps([key, result]) + "\n")
                    file.flush()

            yield known, remember
    except OSError as error:
        raise StoreError(f"cannot write {path}: {error.strerror or error}") from error
