"""Results appear on disk complete or not at all, and replace only what they may replace.

Whatever is written lies under a hidden name beside its target until it is complete, and is then renamed.
A store (directory) replaces only a store of the same format, a file only a file, and both only on request.
The old store steps aside for the new one by two renames: a power cut exactly between them leaves it
under its hidden name ``.<name>.*.old``. What takes long is collected, block by block, in the hidden folder
``.<name>.unfinished``, from where an interrupted run goes on.
"""

from __future__ import annotations

import json
import os
import shutil
import signal
import tempfile
import threading
import uuid
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

from waveformer.simulator.errors import StoreError

_FORMAT_PREFIX = "waveformer."


@contextmanager
def publish(
    path: str | os.PathLike[str], *, overwrite: bool = False, format_name: str | None = None
) -> Iterator[Path]:
    """Write a directory store so that it appears at `path` complete or not at all.

    Args:
        path: where the store shall appear; missing parent folders are created.
        overwrite: replace an existing store, after the new one is complete.
        format_name: the format an existing store must have to be replaced; None means any of waveformer's.

    Yields:
        An empty temporary directory on the same file system, renamed to `path` when the block ends well and
        removed when it ends in any exception, KeyboardInterrupt and SIGTERM included.

    Raises:
        StoreError: `path` exists and may not be replaced, or cannot be written.
    """
    check_writable(path, overwrite, format_name)
    target = Path(os.path.realpath(path))
    try:
        target.parent.mkdir(parents=True, exist_ok=True)
        temporary = Path(tempfile.mkdtemp(prefix=f".{target.name}.", suffix=".partial", dir=target.parent))
    except OSError as error:
        raise StoreError(f"cannot write {path}: {error.strerror}") from error
    try:
        with _terminate_as_exit():
            temporary.chmod(0o777 & ~_umask())  # mkdtemp makes private directories
            yield temporary
            flush_tree(temporary)
            _check_replaceable(path, overwrite, format_name)  # another process may have written meanwhile
            swap_in(temporary, target)
    except OSError as error:
        raise StoreError(f"cannot write {path}: {error.strerror or error}") from error
    finally:
        shutil.rmtree(temporary, ignore_errors=True)  # gone already after the rename


@contextmanager
def publish_file(path: str | os.PathLike[str], *, overwrite: bool = False) -> Iterator[Path]:
    """Like `publish` for a single file, e.g. a picture; yields a temporary path with the same suffix."""
    check_file_writable(path, overwrite)
    target = Path(os.path.realpath(path))
    try:
        target.parent.mkdir(parents=True, exist_ok=True)
        with (
            _terminate_as_exit(),
            tempfile.TemporaryDirectory(
                prefix=f".{target.name}.", suffix=".partial", dir=target.parent
            ) as folder,
        ):
            temporary = Path(folder) / target.name
            yield temporary
            flush(temporary)
            os.replace(temporary, target)
            flush(target.parent)
    except OSError as error:
        raise StoreError(f"cannot write {path}: {error.strerror or error}") from error


def check_writable(
    path: str | os.PathLike[str], overwrite: bool = False, format_name: str | None = None
) -> None:
    """Raise StoreError unless a store can be published at `path`: to be called before a long computation."""
    _check_replaceable(path, overwrite, format_name)
    _check_folder(path)


def check_file_writable(path: str | os.PathLike[str], overwrite: bool = False) -> None:
    """Raise StoreError unless a file can be written at `path`."""
    if Path(path).is_dir():
        raise StoreError(f"{path} is a directory, not a file: choose another path")
    if Path(path).exists() and not overwrite:
        raise StoreError(f"{path} exists; pass --force (overwrite=True) to replace it")
    _check_folder(path)


def store_format(path: str | os.PathLike[str]) -> str | None:
    """The format of a waveformer store, e.g. ``"waveformer.image"``; None for anything else."""
    try:
        attributes = json.loads((Path(path) / "zarr.json").read_text())["attributes"]
        name = attributes["format"]
    except (OSError, ValueError, KeyError, TypeError):
        return None
    return name if isinstance(name, str) and name.startswith(_FORMAT_PREFIX) else None


def unfinished_folder(path: str | os.PathLike[str]) -> Path:
    """The hidden folder in which a store that shall appear at `path` is collected block by block."""
    target = Path(os.path.realpath(path))
    return target.with_name(f".{target.name}.unfinished")


def flush(path: Path) -> None:
    """Wait until a file's bytes, or a folder's names, are on the disk."""
    descriptor = os.open(path, os.O_RDONLY)
    try:
        os.fsync(descriptor)
    finally:
        os.close(descriptor)


def flush_tree(folder: Path) -> None:
    """Flush a folder with all that it holds."""
    for parent, _, files in os.walk(folder, topdown=False):
        for name in files:
            flush(Path(parent) / name)
        flush(Path(parent))


def swap_in(complete: Path, target: Path) -> None:
    """Rename a complete, flushed store to its final name; a store of that name gives way first."""
    if not os.path.lexists(target):
        os.rename(complete, target)
    else:
        retired = target.with_name(f".{target.name}.{uuid.uuid4().hex[:8]}.old")
        os.rename(target, retired)
        try:
            os.rename(complete, target)
        except BaseException:
            os.rename(retired, target)
            raise
        shutil.rmtree(retired, ignore_errors=True)
    flush(target.parent)


def _check_replaceable(path: str | os.PathLike[str], overwrite: bool, format_name: str | None) -> None:
    if not Path(path).name:
        raise StoreError(f"{path!s} cannot name a store: give a new directory such as scan.zarr")
    if not os.path.lexists(path):
        return
    found = store_format(path)
    if found is None:
        raise StoreError(
            f"{path} exists and is not a waveformer store, so it is never replaced: choose another path"
        )
    if format_name is not None and found != format_name:
        raise StoreError(f"{path} holds a {found}, which a {format_name} never replaces: choose another path")
    if not overwrite:
        raise StoreError(f"{path} exists; pass --force (overwrite=True) to replace it")


def _check_folder(path: str | os.PathLike[str]) -> None:
    folder = Path(os.path.realpath(path)).parent
    while not os.path.lexists(folder):
        folder = folder.parent
    try:  # os.access would say yes to root everywhere
        with tempfile.TemporaryFile(dir=folder):
            pass
    except OSError as error:
        raise StoreError(f"cannot write {path}: {folder}: {error.strerror}") from error


@contextmanager
def _terminate_as_exit() -> Iterator[None]:
    """Let SIGTERM unwind the stack, as Ctrl-C does, unless the program has its own handler."""
    in_main = threading.current_thread() is threading.main_thread()
    if not in_main or signal.getsignal(signal.SIGTERM) is not signal.SIG_DFL:
        yield
        return

    def leave(signum: int, frame: Any) -> None:
        raise SystemExit(128 + signum)

    signal.signal(signal.SIGTERM, leave)
    try:
        yield
    finally:
        signal.signal(signal.SIGTERM, signal.SIG_DFL)


def _umask() -> int:
    mask = os.umask(0)
    os.umask(mask)
    return mask
