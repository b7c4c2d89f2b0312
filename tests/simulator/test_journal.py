"""What a journal holds survives torn lines, and what follows them is not lost."""

from __future__ import annotations

from pathlib import Path

import pytest

from waveformer.simulator.journal import Journal


@pytest.mark.parametrize("torn", [b'{"a": 3', b'{"a": 3}', b'\xff\x00\n{"a": 4}\n', b"[3]\n"])
def test_a_torn_line_is_dropped_and_does_not_spoil_the_next(tmp_path: Path, torn: bytes) -> None:
    path = tmp_path / "journal.jsonl"
    journal = Journal(path)
    journal.append({"a": 1})
    journal.append({"a": 2})
    journal.close()
    with path.open("ab") as file:
        file.write(torn)
    journal = Journal(path)
    assert journal.entries == [{"a": 1}, {"a": 2}]
    journal.append({"a": 5})
    journal.close()
    again = Journal(path)
    assert again.entries == [{"a": 1}, {"a": 2}, {"a": 5}]
    again.close()
