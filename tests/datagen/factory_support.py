"""What the tests of the factory share: small datasets, and two of them compared byte by byte."""

from __future__ import annotations

import hashlib
import os
import subprocess
import sys
from pathlib import Path

from factory_makers import layout

from waveformer.datagen.dataset_files import LOCK_FOLDER
from waveformer.datagen.dataset_store import create_dataset
from waveformer.datagen.factory_run import run_factory

HERE = Path(__file__).parent


def new_dataset(root, num_samples=14, maker="plain", **limits):
    create_dataset(root, layout(num_samples, maker, **limits), {"table.txt": b"one\n"}, {})
    return root


def made_dataset(root, num_samples=14, maker="plain", **limits):
    run_factory(new_dataset(root, num_samples, maker, **limits))
    return root


def digests(root):
    """SHA-256 of every file but locks, by relative path."""
    return {
        path.relative_to(root).as_posix(): hashlib.sha256(path.read_bytes()).hexdigest()
        for path in sorted(root.rglob("*"))
        if path.is_file() and LOCK_FOLDER not in path.parts
    }


def start_run(root, workers=1, **popen):
    """A run in a process group of its own, which prints its balance at the end."""
    code = (
        "import sys; from pathlib import Path; from waveformer.datagen.factory_run import run_factory\n"
        "if __name__ == '__main__': print(run_factory(Path(sys.argv[1]), workers=int(sys.argv[2])).balance)"
    )
    script = root.with_name("run_factory.py")
    script.write_text(code)
    environment = {**os.environ, "PYTHONPATH": os.pathsep.join([str(HERE), os.environ.get("PYTHONPATH", "")])}
    return subprocess.Popen(
        [sys.executable, str(script), str(root), str(workers)],
        start_new_session=True,
        stdout=subprocess.PIPE,
        stderr=subprocess.PIPE,
        text=True,
        env=environment,
        **popen,
    )
