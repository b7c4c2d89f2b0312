"""One process at a time in a folder, for as long as it lives."""

from __future__ import annotations

import os
from pathlib import Path

from waveformer.simulator.errors import StoreError


class FileLock:
    """A lock that the system releases when its process ends in any way, kill -9 and power cuts included.

    So it is never stale: the file may stay behind, the lock does not.
    """

    def __init__(self, path: Path) -> None:
        """Create the file, and its folder, and lock it.

        Args:
            path: the lock file; it holds the number of the process that has the lock.

        Raises:
            StoreError: another process, or another part of this one, has the lock.
            OSError: the folder cannot be written, or the disk is full.
        """
        import fcntl

        while True:
            path.parent.mkdir(parents=True, exist_ok=True)
            try:
                descriptor = os.open(path, os.O_RDWR | os.O_CREAT, 0o666)
            except FileNotFoundError:  # its last owner has just removed the folder
                continue
            try:
                fcntl.flock(descriptor, fcntl.LOCK_EX | fcntl.LOCK_NB)
            except BlockingIOError:
                owner = os.read(descriptor, 32).decode(errors="replace").strip() or "unknown"
                os.close(descriptor)
                raise StoreError(
                    f"{path.parent} is in use by process {owner}: wait for it, or choose another path"
                ) from None
            if _is_still(path, descriptor):
                break
            os.close(descriptor)  # its last owner removed it between opening and locking
        try:
            os.ftruncate(descriptor, 0)
            os.write(descriptor, f"{os.getpid()}\n".encode())
        except OSError:  # a full disk: the lock must not outlive the attempt
            os.close(descriptor)
            raise
        self._descriptor: int | None = descriptor

    def release(self) -> None:
        """Let others in; a second call does nothing."""
        if self._descriptor is not None:
            os.close(self._descriptor)
            self._descriptor = None


def _is_still(path: Path, descriptor: int) -> bool:
    try:
        return os.path.samestat(os.stat(path), os.fstat(descriptor))
    except FileNotFoundError:
        return False
