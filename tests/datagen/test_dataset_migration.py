import json
import sys
from pathlib import Path

import pytest

sys.path.insert(0, str(Path(__file__).parent))

from factory_support import HERE, digests, made_dataset

from waveformer.datagen import dataset_migration
from waveformer.datagen.dataset_audit import audit
from waveformer.datagen.dataset_migration import migrate_dataset
from waveformer.simulator.errors import StoreError


@pytest.fixture
def old_dataset(tmp_path, monkeypatch):
    """A dataset as version 1 had it, and the digests it shall have."""
    monkeypatch.setenv("PYTHONPATH", str(HERE))
    root = made_dataset(tmp_path / "store")
    expected = digests(root)
    for path in [root / "dataset.json", *(root / "commit").glob("*.json")]:
        values = {key: value for key, value in json.loads(path.read_text()).items() if key != "sha256"}
        path.write_text(json.dumps({**values, "version": 1}))
    return root, expected


def test_an_old_dataset_says_what_to_do_and_is_migrated(old_dataset):
    root, expected = old_dataset
    with pytest.raises(StoreError, match="has version 1: run waveformer dataset migrate"):
        audit(root)
    assert migrate_dataset(root) == 5
    assert digests(root) == expected and migrate_dataset(root) == 0


@pytest.mark.parametrize("after", range(5))
def test_an_interrupted_migration_goes_on(old_dataset, monkeypatch, after):
    root, expected = old_dataset
    genuine, written = dataset_migration.write_json, []

    def interrupted(path, values):
        if len(written) == after:
            raise KeyboardInterrupt
        written.append(path)
        genuine(path, values)

    monkeypatch.setattr(dataset_migration, "write_json", interrupted)
    with pytest.raises(KeyboardInterrupt):
        migrate_dataset(root)
    monkeypatch.setattr(dataset_migration, "write_json", genuine)
    assert migrate_dataset(root) == 5 - after
    assert digests(root) == expected


def test_a_newer_dataset_is_refused(old_dataset):
    root, _ = old_dataset
    values = json.loads((root / "dataset.json").read_text())
    (root / "dataset.json").write_text(json.dumps({**values, "version": 99}))
    with pytest.raises(StoreError, match="version 99"):
        migrate_dataset(root)
    with pytest.raises(StoreError, match="upgrade"):
        audit(root)
