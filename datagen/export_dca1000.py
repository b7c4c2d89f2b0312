"""Export of signals as recordings of TI's capture card DCA1000: one .bin a sample, and a JSON file beside it.

Every row of H is one chirp of one receiver. Recordings of these radars have the phase exp(+j 2 pi f tau), so H is
conjugated; the JSON file says so, and holds the step of the 16-bit numbers.
"""

from __future__ import annotations

import hashlib
from collections.abc import Callable
from dataclasses import asdict
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from waveformer.datagen.dataset_files import read_json, write_json
from waveformer.datagen.dca1000 import LVDS_LANES, from_dca1000, to_dca1000
from waveformer.datagen.export_choice import SIGNAL, ExportChoice
from waveformer.datagen.export_folder import collected
from waveformer.simulator.errors import RadarError, StoreError
from waveformer.simulator.storage import publish_file

DEFAULT_DEVICE = "xwr18xx"
RECORDING_FORMAT = "waveformer.dca1000"
_LARGEST = 32_767


def export_dca1000(
    choice: ExportChoice,
    out: Path,
    *,
    overwrite: bool = False,
    progress: Callable[[int, int], None] | None = None,
    device: str = DEFAULT_DEVICE,
) -> None:
    """Write OUT/samples/<index>.bin and .json; an interrupted export goes on.

    Args:
        choice: what is exported; only its signals are.
        out: folder, see `export_folder`.
        overwrite: replace an export.
        progress: called with (samples done, samples).
        device: whose order the numbers get, a key of `dca1000.LVDS_LANES`.

    Raises:
        StoreError: the dataset is damaged or has no signals, or `out` cannot be written.
        RadarError: the device is unknown, or cannot record this number of samples a chirp.
    """
    if SIGNAL not in choice.names:
        raise StoreError(f"{choice.data.root} has no signals: generate with --signals, or export to npz")
    signals = ExportChoice(choice.data, choice.indices, (SIGNAL,))
    to_dca1000(*(np.zeros((1, 1, signals.arrays[0].shape[1]), dtype=np.int16),) * 2, device)  # or refuse
    with collected(out, signals, {"layout": "dca1000", "device": device}, overwrite=overwrite) as folder:
        for done, index in enumerate(signals.indices.tolist(), start=1):
            if not (folder / f"{index:08d}.json").exists():  # written last
                _write_recording(folder / f"{index:08d}.bin", signals, index, device)
            if progress is not None:
                progress(done, len(signals))


def read_dca1000(path: Path) -> NDArray[np.complex64]:
    """The signals of an exported recording.

    Args:
        path: of the .bin file.

    Returns:
        H, shape (N, T), with waveformer's sign; each part is within half a step of what was exported.

    Raises:
        StoreError: one of the two files is missing or damaged.
    """
    sidecar = path.with_suffix(".json")
    try:
        values, content = read_json(sidecar), path.read_bytes()
    except OSError as error:
        raise StoreError(f"{error.filename} cannot be read: {error.strerror}") from None
    if values.get("format") != RECORDING_FORMAT:
        raise StoreError(f"{sidecar} does not describe a {RECORDING_FORMAT}")
    if hashlib.sha256(content).hexdigest() != values["sha256"]:
        raise StoreError(f"{path} is damaged: it differs from what was exported")
    try:
        i, q = from_dca1000(content, values["device"], values["num_receivers"], values["num_adc_samples"])
    except RadarError as error:
        raise StoreError(f"{path} is damaged: {error}") from None
    h = np.asarray(float(values["scale"]) * (i - 1j * q), dtype=np.complex64)
    return h.reshape(-1, i.shape[2])


def _write_recording(path: Path, choice: ExportChoice, index: int, device: str) -> None:
    h = choice.data.read(index, choice.names)[SIGNAL].astype(np.complex128)
    if not np.isfinite(h).all():
        raise StoreError(f"{choice.data.root}: the signal of sample {index} is not finite: generate it anew")
    peak = float(max(np.abs(h.real).max(), np.abs(h.imag).max()))
    scale = peak / _LARGEST if peak else 1.0
    i, q = (np.rint(part / scale).astype(np.int16)[:, None] for part in (h.real, -h.imag))
    content = to_dca1000(i, q, device)
    with publish_file(path, overwrite=True) as temporary:
        temporary.write_bytes(content)
    chirp = choice.data.chirp
    sidecar: dict[str, Any] = {
        "format": RECORDING_FORMAT,
        "device": device,
        "lvds_lanes": LVDS_LANES[device],
        "num_chirps": len(h),
        "num_receivers": 1,
        "num_adc_samples": h.shape[1],
        "scale": scale,
        "conjugated": True,
        "sha256": hashlib.sha256(content).hexdigest(),
        "chirp": None if chirp is None else asdict(chirp),
        "index": index,
        "record": choice.data.record(index),
    }
    write_json(path.with_suffix(".json"), sidecar)
