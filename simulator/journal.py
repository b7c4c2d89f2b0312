"""A list that grows by one durable line at a time."""

from __future__ import annotations

import json
import os
from pathlib import Path
from typing import Any

from waveformer.simulator.storage import flush


class Journal:
    """JSON objects, one per line; every line is on the disk before `append` returns.

    A line that a power cut left torn, with all that follows it, is dropped when the file is opened again.

    Attributes:
        entries: the objects, oldest first.
    """

    def __init__(self, path: Path) -> None:
        """Open a journal, or begin one.

        Raises:
            OSError: the file cannot be read or written.
        """
        self.entries: list[dict[str, Any]] = []
        self._file = path.open("a+b")
        self._file.seek(0)
        intact = 0
        for line in self._file:
            entry = _parse(line)
            if entry is None:
                break
            self.entries.append(entry)
            intact += len(line)
        self._file.truncate(intact)
        flush(path.parent)

    def append(self, entry: dict[str, Any]) -> None:
        """Add one object; raises OSError if it cannot be made durable."""
        self._file.write(json.dumps(entry).encode() + b"\n")
        self._file.flush()
        os.fsync(self._file.fileno())
        self.entries.append(entry)

    def close(self) -> None:
        """Close the file; a second call does nothing."""
        self._file.close()


def _parse(line: bytes) -> dict[str, Any] | None:
    if not line.endswith(b"\n"):
        return None
    try:
        entry = json.loads(line)
    except ValueError:
        return None
    return entry if isinstance(entry, dict) else None
