"""The set-up script without a network: what it says on machines where it cannot do its work."""

from __future__ import annotations

import shutil
import subprocess
import tomllib
from pathlib import Path

import pytest

ROOT = Path(__file__).resolve().parents[1]
BASH = shutil.which("bash")
pytestmark = pytest.mark.skipif(BASH is None, reason="bash is not installed")

# Tools the script may use besides those that a test replaces.
TOOLS = ("bash", "cat", "cut", "dirname", "env", "find", "grep", "head", "mkdir", "rm", "sha256sum")

OLD_PYTHON = '[ "$1" = --version ] && echo Python 3.10.12; exit 1'
# Python 3.11 where no library loads and ensurepip is missing, as on a bare Debian 12.
BARE_PYTHON = """
case "$1 $2" in
    *version_info\\ \\<*) exit 0 ;;
    *"%d.%d-venv"*) echo python3.11-venv ;;
    --version*) echo Python 3.11.2 ;;
    *) exit 1 ;;
esac"""


@pytest.fixture
def machine(tmp_path):
    """A copy of the script on a machine with the given programs only, run by an ordinary user."""
    (tmp_path / "scripts").mkdir()
    shutil.copy(ROOT / "scripts" / "setup.sh", tmp_path / "scripts")
    programs = tmp_path / "bin"
    programs.mkdir()
    for tool in TOOLS:
        (programs / tool).symlink_to(shutil.which(tool))

    def _run(**scripts: str) -> subprocess.CompletedProcess[str]:
        defaults = {"id": "echo 1000", "uname": "echo Linux", "ldconfig": "exit 0", "sudo": "exit 1"}
        for name, body in {**defaults, **scripts}.items():
            program = programs / name.replace("_", "-")
            program.write_text(f"#!{BASH}\n{body}\n")
            program.chmod(0o755)
        return subprocess.run(
            [BASH, str(tmp_path / "scripts" / "setup.sh")],
            env={"PATH": str(programs)},
            capture_output=True,
            text=True,
            check=False,
            timeout=60,
        )

    return _run


@pytest.mark.parametrize("script", ["scripts/setup.sh", ".ci/run"])
def test_syntax(script):
    subprocess.run([BASH, "-n", str(ROOT / script)], check=True)


def test_old_python_is_named_with_its_remedy(machine):
    result = machine(python3=OLD_PYTHON)
    assert result.returncode == 1
    assert "Python 3.11 or newer is needed (found: Python 3.10.12)" in result.stderr
    assert "apt-get install -y python3.11 python3.11-venv" in result.stderr


def test_without_privileges_the_exact_command_is_printed(machine, tmp_path):
    result = machine(python3=BARE_PYTHON, apt_get="touch apt-was-called")
    assert result.returncode == 1
    assert result.stderr.splitlines()[1] == (
        "  sudo apt-get update && sudo apt-get install -y --no-install-recommends "
        "libatomic1 libgl1 libegl1 python3.11-venv libllvm19"
    )
    assert not (tmp_path / "apt-was-called").exists()
    assert not (tmp_path / ".venv").exists()


def test_llvm_that_aborts_does_not_count(machine):
    listing = "echo ' libLLVM-15.so.1 (libc6,x86-64) => /usr/lib/x86_64-linux-gnu/libLLVM-15.so.1'"
    assert "libllvm19" in machine(python3=BARE_PYTHON, apt_get="exit 1", ldconfig=listing).stderr


def test_llvm_that_works_is_not_asked_for(machine):
    listing = "echo ' libLLVM.so.19.1 (libc6,x86-64) => /usr/lib/x86_64-linux-gnu/libLLVM.so.19.1'"
    result = machine(python3=BARE_PYTHON, apt_get="exit 1", ldconfig=listing)
    assert "libatomic1" in result.stderr
    assert "libllvm" not in result.stderr


def test_without_apt_the_libraries_are_named(machine):
    result = machine(python3=BARE_PYTHON)
    assert result.returncode == 1
    assert "there is no apt-get" in result.stderr
    assert "libllvm19" in result.stderr


def test_constraints_pin_every_direct_dependency():
    project = tomllib.loads((ROOT / "pyproject.toml").read_text())["project"]
    wanted = [*project["dependencies"], *project["optional-dependencies"]["dev"]]
    pinned = (ROOT / "constraints.txt").read_text().lower()
    for requirement in wanted:
        name = requirement.split(">")[0].split("[")[0].strip().lower()
        assert f"\n{name}==" in pinned, f"constraints.txt does not pin {name}"
    assert "nvidia" not in pinned
    assert "://" not in pinned
