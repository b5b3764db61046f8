"""Installs into the venv that runs it what a target of the Makefile needs, and says in a few lines what it does.

`install.py [EXTRA]` takes the pinned versions of constraints.txt, `install.py --locked` the files of the locks and no
others. Everything that pip says goes to pip.log in the venv; its end is printed when pip fails. For tests our loops
and the test modules are compiled then. Standard library only.
"""

import importlib.metadata
import os
import re
import shutil
import subprocess
import sys
import time
from pathlib import Path

LOG = Path(sys.prefix) / "pip.log"
TORCH_LOCK = "requirements-torch.lock"
NOISE = re.compile(r"WARNING: Location .* is ignored|^\s*$")
"""What pip says of every package where a configured folder of packages is absent."""


def main():
    """Exit code: 0 when everything is installed."""
    LOG.unlink(missing_ok=True)
    locked, extra = "--locked" in sys.argv, "".join(sys.argv[1:2])
    how = "from the locks, every digest checked" if locked else extra or "about 2.5 GB, some minutes the first time"
    print(f"Installing into {LOG.parent} ({how})", flush=True)
    code = install_locked() if locked else install_constrained(f".[{extra}]" if extra else ".")
    if code == 0 and (locked or extra == "test"):
        code = compile_for_tests()
    return code


def install_constrained(project):
    """Installs the project with the versions of constraints.txt."""
    index = os.environ.get("TORCH_INDEX", "")
    constraints = ["-c", "constraints.txt"]
    if index and not has_torch():  # what torch needs comes with the project, from the usual place
        code = pip([*constraints, "--no-deps", "--index-url", index, "torch"])
        if code:
            return code
    build = [] if has_torch() else cpu_build()
    return pip([*constraints, *build, "-e", project])


def install_locked():
    """Installs the files of the locks, then the project without looking for anything else."""
    index = ["--index-url", os.environ["TORCH_INDEX"]] if os.environ.get("TORCH_INDEX") else []
    build = LOG.with_name("torch-build.txt")  # with digests pip prefers an index to a folder, whatever the build
    build.write_text("\n".join([] if index or has_torch() else cpu_build()))
    checked = ["--require-hashes", "--no-deps"]
    code = pip([*checked, "-r", "requirements.lock"]) or pip([*checked, *index, "-c", str(build), "-r", TORCH_LOCK])
    if code == 0 and wants_cuda():
        code = pip([*checked, "-r", "requirements-cuda.lock"])
    return code or pip(["--no-deps", "--no-build-isolation", "-e", "."])


def compile_for_tests():
    """Compiles our loops and, beside them, the test modules, which each process of pytest would do again; exit code."""
    collect = [sys.executable, "-m", "pytest", "--collect-only", "--quiet"]
    environment = {name: value for name, value in os.environ.items() if name != "PYTHONDONTWRITEBYTECODE"}
    with subprocess.Popen(collect, env=environment, stdout=subprocess.DEVNULL) as tests:
        loops = subprocess.run([sys.executable, ".ci/compile_loops.py"], env=environment).returncode
    if tests.returncode:
        print("  The tests cannot be collected; `.venv/bin/python -m pytest --collect-only` says why.")
    return loops or tests.returncode


def cpu_build():
    """The requirement that keeps CUDA away where there is no NVIDIA driver and pip finds such a build of torch.

    Where pip finds none, a line says how much it would save; nothing has been downloaded then.
    """
    if sys.platform != "linux" or has_nvidia_driver():
        return []
    build = f"torch=={pinned_torch()}+cpu"
    code, said, _ = run_pip(["install", "--dry-run", "--no-deps", build])
    if code and "No matching distribution" in said and "(from versions: none)" not in said:
        print(cuda_warning(), flush=True)
    return [] if code else [build]


def cuda_warning():
    """How much a build without CUDA would save, from the sizes that the lock names."""
    sizes = re.search(r"(\d+) MB with CUDA, (\d+) MB without", Path(TORCH_LOCK).read_text())
    assert sizes, f"{TORCH_LOCK} names no sizes"
    with_cuda, without = map(int, sizes.groups())
    return (
        f"  torch: there is no NVIDIA driver, but pip finds only the build with CUDA, {with_cuda} MB to download; "
        f"make TORCH_INDEX=<PyTorch's index of CPU builds> would save {with_cuda - without} MB of them"
    )


def pip(arguments):
    """Runs `pip install`, says what it brought and how long that took, and on failure the end of what pip said."""
    start = time.monotonic()
    # Python compiles what it loads; doing it for all of every package beforehand would take half the time.
    code, said, unpacking = run_pip(["install", "--no-compile", *arguments])
    if code:
        lines = [line for line in said.splitlines() if not NOISE.search(line)]
        errors = "\n".join("  " + line for line in lines[-12:])
        print(
            f"make: pip install failed (exit code {code}); all it said is in {LOG}. The end:\n{errors}", file=sys.stderr
        )
        return code
    found = re.search(r"^Successfully installed (.*)$", said, re.MULTILINE)
    names = [name for name in found.group(1).split() if not name.startswith("personal-viz-")] if found else []
    if names:
        shown = ", ".join(n for n in names if n.startswith("torch-")) or f"{names[0]} ..."
        print(
            f"  {len(names)} packages ({shown}): found and downloaded in {unpacking - start:.0f} s, "
            f"installed in {time.monotonic() - unpacking:.0f} s",
            flush=True,
        )
    return 0


def run_pip(arguments):
    """(exit code, what pip said, when it had downloaded everything and began to unpack; monotonic seconds)."""
    command = [sys.executable, "-m", "pip", "--disable-pip-version-check", "--no-input", *arguments]
    said, unpacking = [], time.monotonic()
    with LOG.open("a") as log:
        log.write(f"$ {' '.join(command)}\n")
        with subprocess.Popen(command, stdout=subprocess.PIPE, stderr=subprocess.STDOUT, text=True) as process:
            for line in process.stdout or ():
                log.write(line)
                said.append(line)
                if line.startswith("Installing collected packages"):
                    unpacking = time.monotonic()
    return process.returncode, "".join(said), unpacking


def pinned_torch():
    """The version of torch in constraints.txt."""
    return re.findall(r"^torch==(\S+)$", Path("constraints.txt").read_text(), re.MULTILINE)[0]


def has_torch():
    """Whether the pinned version is installed, whichever build."""
    try:
        return importlib.metadata.version("torch").split("+")[0] == pinned_torch()
    except importlib.metadata.PackageNotFoundError:
        return False


def wants_cuda():
    """Whether the installed build of torch loads CUDA's libraries from packages of their own."""
    return any(name.startswith(("nvidia-", "cuda-")) for name in importlib.metadata.requires("torch") or ())


def has_nvidia_driver():
    """Whether this machine has an NVIDIA driver."""
    return os.path.exists("/proc/driver/nvidia") or shutil.which("nvidia-smi") is not None


if __name__ == "__main__":
    sys.exit(main())
