#!/usr/bin/env bash
# Makes a fresh clone ready to run: system libraries, then .venv with the pinned Python packages, then a
# check of the result. Running it again is safe and quick; an interrupted run is repaired by the next one.
#
#   PYTHON=/path/to/python3   use this interpreter instead of the first python >= 3.11 found
set -euo pipefail
cd "$(dirname "${BASH_SOURCE[0]}")/.."

say() { printf 'setup: %s\n' "$*"; }
stop() {
    printf 'setup: error: %s\n' "$*" >&2
    exit 1
}

# One set-up at a time (make -j): the lock lives on this file, so nothing is left behind.
if command -v flock >/dev/null; then
    exec 9<scripts/setup.sh
    flock 9
fi

# ---- Python --------------------------------------------------------------------------------------------

find_python() {
    local candidate
    for candidate in ${PYTHON:-python3 python3.13 python3.12 python3.11}; do
        if "$candidate" -c 'import sys; sys.exit(sys.version_info < (3, 11))' 2>/dev/null; then
            printf '%s' "$candidate"
            return
        fi
    done
    local found
    found="$(${PYTHON:-python3} --version 2>&1 | head -n 1 || true)"
    stop "Python 3.11 or newer is needed (found: ${found:-none}). Debian 12: apt-get install -y python3 python3-venv;" \
        "Ubuntu 22.04: apt-get install -y python3.11 python3.11-venv; or set PYTHON=/path/to/python3"
}

# ---- System libraries ----------------------------------------------------------------------------------

loads() { "$python" -c 'import ctypes, sys; ctypes.CDLL(sys.argv[1])' "$1" 2>/dev/null; }

# LLVM 14 is too old for Dr.Jit; 15 and 16 load but abort at the first float maximum. 19 is the tested one.
have_llvm() {
    [[ -n "${DRJIT_LIBLLVM_PATH:-}" ]] && return 0
    local name
    # A here-string, not a pipe: the loop's return must leave this function.
    while read -r name; do
        [[ "$name" =~ libLLVM(-|\.so\.)([0-9]+) ]] && ((BASH_REMATCH[2] >= 17)) && return 0
    done <<<"$(
        PATH="$PATH:/usr/sbin:/sbin" ldconfig -p 2>/dev/null | grep -o 'libLLVM[^ ]*' || true
        find /usr/lib/llvm-*/lib .system-libs .venv/share/waveformer-libs "${CONDA_PREFIX:-/nonexistent}/lib" \
            -maxdepth 4 -name 'libLLVM*.so*' 2>/dev/null || true
    )"
    return 1
}

# No pipe into grep -q: it would close early and pipefail would report apt-cache's broken pipe.
in_archive() { [[ "$(apt-cache policy "$1" 2>/dev/null)" =~ Candidate:\ [0-9] ]]; }

# The best LLVM package the archive offers, nothing if it offers none.
llvm_package() {
    local package
    for package in libllvm19 libllvm20 libllvm21 libllvm18 libllvm17 libllvm17t64; do
        if in_archive "$package"; then
            printf '%s' "$package"
            return
        fi
    done
}

# Sets `missing` to the Debian packages this machine lacks, and `missing_llvm` to 1 or nothing.
find_missing() {
    missing=() missing_llvm=
    loads libatomic.so.1 || missing+=(libatomic1)
    loads libGL.so.1 || missing+=(libgl1)
    loads libEGL.so.1 || missing+=(libegl1)
    "$python" -c 'import ensurepip' 2>/dev/null ||
        missing+=("$("$python" -c 'import sys; print("python%d.%d-venv" % sys.version_info[:2])')")
    have_llvm || missing_llvm=1
}

is_complete() { [[ ${#missing[@]} == 0 && -z "$missing_llvm" ]]; }

# Without package lists, or with stale ones, the first attempt cannot work: the second one updates them.
install_system_libraries() {
    local privileged llvm package attempt
    [[ "$(uname -s)" == Linux ]] || return 0
    find_missing
    if is_complete; then return 0; fi

    local wanted="${missing[*]} ${missing_llvm:+libllvm19}"
    command -v apt-get >/dev/null ||
        stop "system libraries are missing and there is no apt-get; install what Debian calls: $wanted"
    if [[ "$(id -u)" == 0 ]]; then
        privileged=(env DEBIAN_FRONTEND=noninteractive)
    elif sudo -n true 2>/dev/null; then
        privileged=(sudo -n env DEBIAN_FRONTEND=noninteractive)
    else
        stop "system libraries are missing and this user may not install them; run this, then repeat:
  sudo apt-get update && sudo apt-get install -y --no-install-recommends ${wanted# }"
    fi

    say "installing system libraries: ${wanted# }"
    rm -f "$checked"
    for attempt in as-is updated; do
        if [[ "$attempt" == updated ]]; then
            "${privileged[@]}" apt-get -q -o DPkg::Lock::Timeout=300 update ||
                stop "apt-get update failed; is the network reachable?"
        fi
        llvm=
        if [[ -n "$missing_llvm" ]]; then
            llvm="$(llvm_package)"
            [[ -n "$llvm" ]] || continue
        fi
        for package in "${missing[@]}"; do in_archive "$package" || continue 2; done
        "${privileged[@]}" apt-get -q -o DPkg::Lock::Timeout=300 install -y --no-install-recommends \
            "${missing[@]}" $llvm && break
    done
    find_missing
    if is_complete; then return 0; fi
    [[ -z "$missing_llvm" ]] ||
        stop "this system's archive offers no LLVM of version 17 or newer (19 is the tested one);" \
            "install one by hand and set DRJIT_LIBLLVM_PATH=/path/to/libLLVM.so.19.1"
    stop "apt-get could not install: ${missing[*]}"
}

# ---- Python packages -----------------------------------------------------------------------------------

# .venv/.waveformer-setup says how far the set-up of this .venv came: "incomplete", or the hash of what it
# was made from. An incomplete one is thrown away; a .venv without that file is the user's own and is kept.
install_python_packages() {
    local quiet=()
    [[ -t 1 ]] || quiet=(--quiet)
    if [[ -f "$stamp" && "$(cat "$stamp")" == incomplete ]]; then
        say "the last set-up was interrupted: starting .venv again"
        rm -rf .venv
    fi
    if [[ ! -x .venv/bin/python ]]; then
        say "creating .venv with $("$python" --version)"
        mkdir -p .venv
        echo incomplete >"$stamp"
        "$python" -m venv .venv
    elif ! .venv/bin/python -c 'import pip, sys; sys.exit(sys.version_info < (3, 11))' 2>/dev/null; then
        stop ".venv is broken or older than Python 3.11: remove it (rm -rf .venv) and repeat"
    fi
    echo incomplete >"$stamp"
    say "installing Python packages: some minutes on the first run; 2.5 GB, or 8 GB where torch brings CUDA along"
    .venv/bin/python -m pip install --disable-pip-version-check --no-input "${quiet[@]}" \
        -c constraints.txt -e '.[dev]'
    echo "$1" >"$stamp"
}

python="$(find_python)"
stamp=.venv/.waveformer-setup
checked=.venv/.waveformer-checked

install_system_libraries

# The path is part of it: scripts inside a .venv break when the folder moves.
wanted_hash="$({ pwd; "$python" --version; cat pyproject.toml constraints.txt scripts/setup.sh; } | sha256sum | cut -c1-64)"
if [[ ! -x .venv/bin/waveformer || "$(cat "$stamp" 2>/dev/null)" != "$wanted_hash" ]]; then
    install_python_packages "$wanted_hash"
fi
if [[ "$(cat "$checked" 2>/dev/null)" != "$wanted_hash" ]]; then
    say "checking the installation"
    .venv/bin/waveformer doctor || stop "the check above failed: follow its remedies, then repeat"
    echo "$wanted_hash" >"$checked"
    say "done"
else
    say "up to date"
fi
