"""What `waveformer doctor` tries out, each probe in a process of its own.

A broken libLLVM or a missing OpenGL library ends the process it is used in (abort, segmentation fault),
so nothing here runs in the process that prints the report. A probe returns what it found, and raises if
the thing does not work.
"""

from __future__ import annotations

import ctypes
import importlib
import json
import os
import platform
import shutil
import sys
import tempfile
from collections.abc import Callable
from pathlib import Path

from waveformer.simulator.errors import WaveformerError

OK, WARN, FAIL = "ok", "warn", "fail"
Finding = tuple[str, str]  # (status, what was found)

MINIMUM_FREE_DISK_BYTES = 5e9
MINIMUM_MEMORY_BYTES = 4e9


def python() -> Finding:
    """Interpreter version."""
    status = OK if sys.version_info >= (3, 11) else FAIL
    return (
        status,
        f"{platform.python_version()} on {platform.system()} {platform.machine()} ({sys.executable})",
    )


def libatomic() -> Finding:
    """The system library that Dr.Jit links to."""
    if sys.platform != "linux":
        return OK, "not needed on this system"
    ctypes.CDLL("libatomic.so.1")
    return OK, "libatomic.so.1 loads"


def libllvm() -> Finding:
    """The libLLVM chosen, and one float maximum really compiled with it."""
    from waveformer.simulator.runtime import DEVICE_VARIABLE, TESTED_LLVM_MAJOR, activate, llvm_major

    os.environ[DEVICE_VARIABLE] = "cpu"  # this process looks at LLVM, whatever device the simulator is to use
    activate()
    drjit = importlib.import_module("drjit")
    mitsuba = importlib.import_module("mitsuba")
    maximum = drjit.maximum(mitsuba.Float([1.0, -2.0]), mitsuba.Float([0.5, 3.0]))
    if list(maximum) != [1.0, 3.0]:
        return FAIL, f"maximum of (1, -2) and (0.5, 3) came out as {list(maximum)}"
    path = Path(os.environ["DRJIT_LIBLLVM_PATH"])
    major = llvm_major(path)
    tested = "" if major == TESTED_LLVM_MAJOR else f", not the tested {TESTED_LLVM_MAJOR}"
    return OK, f"LLVM {major}{tested}: {path}, float maximum computed"


def mitsuba() -> Finding:
    """One ray traced against one rectangle with the variant the simulator uses."""
    from waveformer.simulator.runtime import VARIANTS, activate, chosen_device

    activate()
    mi = importlib.import_module("mitsuba")
    scene = mi.load_dict({"type": "scene", "rectangle": {"type": "rectangle"}})
    hit = scene.ray_intersect(mi.Ray3f(mi.Point3f(0.1, 0.2, 2.0), mi.Vector3f(0.0, 0.0, -1.0)))
    distance = float(hit.t[0])
    if abs(distance - 2.0) > 1e-5:
        return FAIL, f"a ray hit the plane z = 0 from z = 2 at distance {distance}"
    return OK, f"mitsuba {mi.__version__}, {VARIANTS[chosen_device()]}: a ray hit its target"


def device() -> Finding:
    """What the simulator runs on, and whether it could run on CUDA."""
    from waveformer.simulator.runtime import DEVICE_VARIABLE, chosen_device

    drjit = importlib.import_module("drjit")
    chosen = chosen_device()
    has_cuda = drjit.has_backend(drjit.JitBackend.CUDA)
    reason = f"by {DEVICE_VARIABLE}" if os.environ.get(DEVICE_VARIABLE) else "the default"
    status = FAIL if chosen == "cuda" and not has_cuda else OK
    return status, f"{chosen} ({reason}); CUDA {'possible' if has_cuda else 'not possible here'}"


def gpu() -> Finding:
    """For information: what torch could use."""
    torch = importlib.import_module("torch")
    name = torch.cuda.get_device_name(0) if torch.cuda.is_available() else "none"
    return OK, f"for torch: {name} (optional)"


def torch() -> Finding:
    """One matrix product and one gradient."""
    module = importlib.import_module("torch")
    weights = module.ones(2, 2, requires_grad=True)
    (weights @ module.ones(2)).sum().backward()
    if weights.grad.tolist() != [[1.0, 1.0], [1.0, 1.0]]:
        return FAIL, f"torch {module.__version__} computed the wrong gradient {weights.grad.tolist()}"
    return OK, f"torch {module.__version__}, {module.get_num_threads()} threads"


def pyvista() -> Finding:
    """A picture rendered without a display."""
    module = importlib.import_module("pyvista")
    plotter = module.Plotter(off_screen=True, window_size=(64, 64))
    plotter.add_mesh(module.Sphere())
    picture = plotter.screenshot(return_img=True)
    plotter.close()
    if picture.std() == 0:
        return FAIL, "the off-screen picture is empty"
    return OK, f"pyvista {module.__version__}, off-screen picture rendered"


def zarr() -> Finding:
    """An array written to the temporary folder and read back."""
    module = importlib.import_module("zarr")
    numpy = importlib.import_module("numpy")
    values = numpy.arange(12, dtype=numpy.complex64).reshape(3, 4)
    with tempfile.TemporaryDirectory() as folder:
        store = Path(folder) / "probe.zarr"
        module.create_array(store=store, data=values)
        read = module.open_array(store=store, mode="r")[:]
    if not numpy.array_equal(read, values):
        return FAIL, f"zarr {module.__version__}: the array read back differs from the one written"
    return OK, f"zarr {module.__version__}, array written and read back"


def disk() -> Finding:
    """Free space where the command was started."""
    free_bytes = shutil.disk_usage(".").free
    return (
        OK if free_bytes >= MINIMUM_FREE_DISK_BYTES else WARN
    ), f"{free_bytes / 1e9:.1f} GB free in {Path.cwd()}"


def threads() -> Finding:
    """Cores this process may use, and a limit set by the user."""
    cores = len(os.sched_getaffinity(0)) if hasattr(os, "sched_getaffinity") else os.cpu_count()
    limit = os.environ.get("WAVEFORMER_THREADS")
    if limit and not (limit.isdecimal() and int(limit) >= 1):
        return FAIL, f"WAVEFORMER_THREADS={limit} is not a positive integer"
    return OK, f"{cores} cores" + (f", limited to {limit} threads by WAVEFORMER_THREADS" if limit else "")


def memory() -> Finding:
    """Memory that is free for work."""
    try:
        lines = Path("/proc/meminfo").read_text().splitlines()
        available_bytes = 1024 * int(
            next(line for line in lines if line.startswith("MemAvailable")).split()[1]
        )
    except (OSError, StopIteration):
        return OK, "cannot be told on this system"
    status = OK if available_bytes >= MINIMUM_MEMORY_BYTES else WARN
    return status, f"{available_bytes / 1e9:.1f} GB available"


PROBES: dict[str, Callable[[], Finding]] = {
    probe.__name__: probe
    for probe in (
        python,
        libatomic,
        libllvm,
        device,
        mitsuba,
        gpu,
        torch,
        pyvista,
        zarr,
        disk,
        threads,
        memory,
    )
}


def report(name: str) -> None:
    """Run one probe and print its finding as one line of JSON, the last line of the output."""
    try:
        status, found = PROBES[name]()
    except Exception as error:  # noqa: BLE001
        # Whatever goes wrong is the finding; the parent process prints it next to the remedy.
        lines = str(error).strip().splitlines() or ["no message"]
        kind = "" if isinstance(error, WaveformerError) else f"{type(error).__name__}: "
        status, found = FAIL, kind + lines[0]
    print(json.dumps({"status": status, "found": found}), flush=True)
