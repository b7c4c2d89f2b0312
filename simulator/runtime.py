"""Start the ray tracer: choose CPU or CUDA, find an LLVM that works, then set the Mitsuba variant, explicitly and once.

Dr.Jit compiles kernels through a system libLLVM. Versions 14 and older are refused by Dr.Jit itself;
15 and 16 load, but every float minimum or maximum then aborts the whole process (llvm-project issue
53353), which no Python code can catch. So the version is decided *before* drjit is imported, from the
name of the file, and never by trying it in this process.
"""

from __future__ import annotations

import os
import re
import subprocess
import sys
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path

from waveformer.simulator.errors import SetupError

# Device of the kernels and rays -> Mitsuba variant. Without a choice of the user it is the first.
VARIANTS = {"cpu": "llvm_ad_rgb", "cuda": "cuda_ad_rgb"}
MINIMUM_LLVM_MAJOR = 17
TESTED_LLVM_MAJOR = 19

LIBRARY_PATH_VARIABLE = "DRJIT_LIBLLVM_PATH"
THREADS_VARIABLE = "WAVEFORMER_THREADS"
DEVICE_VARIABLE = "WAVEFORMER_DEVICE"

LLVM_REMEDY = (
    f"apt-get install -y --no-install-recommends libllvm{TESTED_LLVM_MAJOR} "
    f"(or set {LIBRARY_PATH_VARIABLE} to the libLLVM of LLVM {TESTED_LLVM_MAJOR})"
)
ATOMIC_REMEDY = "apt-get install -y --no-install-recommends libatomic1"
CUDA_REMEDY = f"install the NVIDIA driver, or unset {DEVICE_VARIABLE} to use the CPU"

# libLLVM.so.19.1, libLLVM-19.so, libLLVM-15.so.1, libLLVM-14.0.6.so.1; a bare libLLVM.so names no version.
_MAJOR_IN_NAME = re.compile(r"^libLLVM(?:-|\.so\.)(\d+)")
_SHARED_LIBRARY = re.compile(r"^libLLVM(?:-\d[\w.]*)?\.(?:so(?:\.[\d.]+)?|dylib)$")

# Asks a libLLVM for its version in a child process. LLVMGetVersion exists since LLVM 16.
_ASK_VERSION = """
import ctypes, sys
major, minor, patch = ctypes.c_uint(), ctypes.c_uint(), ctypes.c_uint()
ctypes.CDLL(sys.argv[1]).LLVMGetVersion(ctypes.byref(major), ctypes.byref(minor), ctypes.byref(patch))
print(major.value)
"""


@dataclass(frozen=True)
class LlvmLibrary:
    """One libLLVM on this machine.

    Attributes:
        path: the shared library.
        major: major version; 0 if it could not be told, which means older than 16 or broken.
    """

    path: Path
    major: int

    @property
    def is_usable(self) -> bool:
        """True if float minimum and maximum can be compiled with it."""
        return self.major >= MINIMUM_LLVM_MAJOR


def llvm_major(path: Path) -> int:
    """Major version of a libLLVM from its file name, else by asking it in a child process; 0 if unknown."""
    for name in (path.name, path.resolve().name):
        if match := _MAJOR_IN_NAME.match(name):
            return int(match[1])
    try:
        answer = subprocess.run(
            [sys.executable, "-c", _ASK_VERSION, str(path)],
            check=False,
            capture_output=True,
            text=True,
            timeout=60,
        )
        return int(answer.stdout) if answer.returncode == 0 else 0
    except (OSError, ValueError, subprocess.TimeoutExpired):
        return 0


def search_directories() -> Iterator[Path]:
    """Folders that may hold a libLLVM, the private ones of this installation first."""
    repository = Path(__file__).resolve().parents[1]
    for unpacked in (Path(sys.prefix) / "share" / "waveformer-libs", repository / ".system-libs"):
        # dpkg -x keeps the package's own tree below the folder it unpacks into.
        yield from (unpacked, *sorted(unpacked.glob("usr/lib/*")), *sorted(unpacked.glob("usr/lib/*/lib")))
    for prefix in filter(None, (os.environ.get("CONDA_PREFIX"), sys.prefix, sys.base_prefix)):
        yield Path(prefix) / "lib"
    for triplet in ("x86_64-linux-gnu", "aarch64-linux-gnu"):
        yield Path("/usr/lib") / triplet
    yield from (Path("/usr/lib64"), Path("/usr/lib"), Path("/usr/local/lib"))
    yield from sorted(Path("/usr/lib").glob("llvm-*/lib"))
    yield from sorted(Path("/opt/homebrew/opt").glob("llvm*/lib"))


def installed_libraries() -> list[LlvmLibrary]:
    """Every libLLVM found, best first: the tested version, then newest to oldest.

    A set ``DRJIT_LIBLLVM_PATH`` is a decision of the user: it is then the only entry.
    """
    if chosen := os.environ.get(LIBRARY_PATH_VARIABLE):
        path = Path(chosen)
        return [LlvmLibrary(path, llvm_major(path))] if path.is_file() else []
    found: dict[Path, LlvmLibrary] = {}
    for directory in search_directories():
        for path in sorted(directory.glob("libLLVM*")):
            if _SHARED_LIBRARY.match(path.name) and path.is_file() and path.resolve() not in found:
                found[path.resolve()] = LlvmLibrary(path.resolve(), llvm_major(path))
    # sorted() is stable: of two libraries of one version the earlier folder wins.
    return sorted(found.values(), key=lambda library: (library.major != TESTED_LLVM_MAJOR, -library.major))


def find_libllvm() -> Path | None:
    """The libLLVM to use, or None if this machine has none that works.

    Returns:
        ``DRJIT_LIBLLVM_PATH`` if it is set and usable; else LLVM 19, the tested one, if present; else
        the newest of at least 17.
    """
    return next((library.path for library in installed_libraries() if library.is_usable), None)


def require_libllvm() -> Path:
    """The libLLVM to use.

    Raises:
        SetupError: none is usable; the message names what was found and the remedy.
    """
    libraries = installed_libraries()
    if libraries and libraries[0].is_usable:
        return libraries[0].path
    if chosen := os.environ.get(LIBRARY_PATH_VARIABLE):
        if not libraries:
            raise SetupError(f"{LIBRARY_PATH_VARIABLE} is set to {chosen!r}, which is no file: {LLVM_REMEDY}")
        reason = f"{LIBRARY_PATH_VARIABLE} points to {_describe(libraries[0])}"
    elif libraries:
        reason = f"the newest libLLVM found is {_describe(libraries[0])}"
    else:
        reason = "no libLLVM found"
    raise SetupError(f"{reason}; LLVM {MINIMUM_LLVM_MAJOR} or newer is needed: {LLVM_REMEDY}")


def chosen_device() -> str:
    """The device to use: ``WAVEFORMER_DEVICE`` if it is set, else ``"cpu"``.

    Raises:
        SetupError: it is neither ``cpu`` nor ``cuda``.
    """
    device = os.environ.get(DEVICE_VARIABLE) or next(iter(VARIANTS))
    if device not in VARIANTS:
        raise SetupError(f"{DEVICE_VARIABLE} must be {' or '.join(VARIANTS)}, got {device!r}")
    return device


def activate(num_threads: int | None = None) -> None:
    """Choose the Mitsuba variant of the device, ``llvm_ad_rgb`` or ``cuda_ad_rgb``; cheap when already done.

    The device is that of ``WAVEFORMER_DEVICE``, see `chosen_device`; it cannot change once kernels are loaded. There
    is no fallback to another variant: scalar is some fifty times slower and has no gradients.

    Args:
        num_threads: threads of Dr.Jit; None = ``WAVEFORMER_THREADS`` if set, else left as it is (at the
            start all cores). One thread gives the same bits on every run on the CPU.

    Raises:
        SetupError: the device is unknown, missing, or another one than the kernels were loaded for; libLLVM is
            missing or too old, a system library is missing, or the thread count is not a positive integer.
    """
    threads = _thread_count(num_threads)
    device = chosen_device()
    _refuse_second_device(device)
    variant = VARIANTS[device]
    loaded = sys.modules.get("mitsuba")
    if device == "cpu" and (loaded is None or loaded.variant() != variant):
        # Read when a variant is first chosen, so this also serves a caller who imported mitsuba before.
        os.environ[LIBRARY_PATH_VARIABLE] = str(require_libllvm())
    try:
        import drjit
        import mitsuba
    except (ImportError, NameError, OSError) as error:
        # A missing libatomic.so.1 shows up as a NameError inside drjit.
        reason = str(error).splitlines()[0] if str(error) else type(error).__name__
        raise SetupError(f"mitsuba cannot be imported ({reason}): {ATOMIC_REMEDY}") from error
    if mitsuba.variant() != variant:
        try:
            mitsuba.set_variant(variant)
        except ImportError as error:
            reason = str(error).splitlines()[0]
            remedy = LLVM_REMEDY if device == "cpu" else CUDA_REMEDY
            raise SetupError(f"Mitsuba variant {variant} does not start ({reason}): {remedy}") from error
    if threads is not None:
        drjit.set_thread_count(threads)


def _refuse_second_device(device: str) -> None:
    backend = sys.modules.get("waveformer.simulator.backend")
    if backend is not None and device != backend.DEVICE:
        raise SetupError(
            f"{DEVICE_VARIABLE} asks for {device}, but the kernels of this process are loaded for {backend.DEVICE}: "
            "set it before the first simulation"
        )


def _describe(library: LlvmLibrary) -> str:
    version = f"LLVM {library.major}" if library.major else "of an unknown, old version"
    return f"{library.path} ({version})"


def _thread_count(num_threads: int | None) -> int | None:
    if num_threads is not None:
        if num_threads < 1:
            raise SetupError(f"num_threads must be at least 1, got {num_threads}")
        return num_threads
    text = os.environ.get(THREADS_VARIABLE)
    if not text:
        return None
    if not text.isdecimal() or int(text) < 1:
        raise SetupError(f"{THREADS_VARIABLE} must be a positive integer, got {text!r}")
    return int(text)
