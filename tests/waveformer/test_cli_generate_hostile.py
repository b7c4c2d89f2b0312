"""`waveformer generate` on a folder of hundreds of hostile files among good ones, with signals, as a user runs it."""

import json
import re
import resource
import runpy
import subprocess
import sys
import time
from collections import Counter
from pathlib import Path

import pytest

from waveformer.datagen.catalog import Catalog
from waveformer.datagen.dataset_reader import open_dataset

CONFIG = """
views = 1
truth_points = 1024
time_limit_s = 60
memory_limit_gib = 1.5
workers = 2
[objects]
meshes = "root"
unit_m = 1.0
[aperture]
num_x = 8
num_y = 8
[placement]
longest_side_m = [0.05, 0.08]
[signal]
"""
HOSTILE = Path(__file__).parents[1] / "datagen/hostile_meshes.py"


@pytest.mark.slow
def test_hostile_files_stop_nothing(tmp_path, capsys):
    outside = tmp_path / "outside/secret.stl"
    outside.parent.mkdir()
    outside.write_bytes(b"solid secret\nendsolid secret\n")
    (tmp_path / "root").mkdir()
    wanted = runpy.run_path(str(HOSTILE))["write_hostile_files"](tmp_path / "root", outside)
    (tmp_path / "hostile.toml").write_text(CONFIG)
    command = [sys.executable, "-m", "waveformer", "generate", "hostile.toml", "--out", "store", "--json"]
    started = time.perf_counter()
    done = subprocess.run(command, cwd=tmp_path, capture_output=True, text=True, check=False)
    seconds = time.perf_counter() - started
    assert done.returncode in (0, 1) and "Traceback" not in done.stderr, done.stderr
    summary = json.loads(done.stdout)
    assert summary["requested"] == summary["committed"] + summary["quarantined"] and summary["pending"] == 0
    assert done.returncode == (1 if summary["quarantined"] else 0)

    entries = Catalog.read(tmp_path / "store.catalog.parquet").entries
    usable = [entry for entry in entries if not entry.reason]
    assert len(usable) == summary["requested"]
    hostile = sum(want != "good" for want in wanted.values())
    assert hostile >= 300
    data = open_dataset(tmp_path / "store")
    made = {data.record(index)["object_id"] for index in data.indices}
    good = {entry.object_id for entry in usable if wanted.get(entry.path) == "good"}
    assert good and good <= made  # none of the good ones suffered
    for reason in data.quarantined.values():
        assert re.fullmatch(r"[ -~]{10,400}", reason), reason
    peak_bytes = resource.getrusage(resource.RUSAGE_CHILDREN).ru_maxrss * 1024
    assert peak_bytes < 2 * 2**30
    with capsys.disabled():
        print(
            f"\nhostile {hostile}, good {len(good)}: left out by the scan {len(entries) - len(usable)}, committed "
            f"{summary['committed']}, quarantined {dict(Counter(data.quarantined.values()))}; {seconds:.0f} s, largest "
            f"process {peak_bytes / 2**30:.2f} GiB"
        )
