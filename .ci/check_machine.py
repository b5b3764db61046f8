"""Says in one line what this machine lacks, with the exact command that brings it; standard library only.

`check_machine.py` checks Python, which is all that `make demo` needs; `--tests` also wants Open3D's libraries and a
Chromium or Chrome, and installs Debian's when run as root.
"""

import ctypes
import importlib.util
import os
import shutil
import subprocess
import sys

LIBRARIES = {
    "libGL.so.1": "libgl1",
    "libEGL.so.1": "libegl1",
    "libX11.so.6": "libx11-6",
    "libusb-1.0.so.0": "libusb-1.0-0",
    "libudev.so.1": "libudev1",
    "libgomp.so.1": "libgomp1",
}
"""Shared libraries that Open3D's Linux wheels load, and the Debian packages that hold them."""
BROWSERS = ("chromium", "chromium-browser", "google-chrome", "google-chrome-stable")


def main() -> int:
    """Exit code: 0 when everything is there, 1 otherwise."""
    problem = python_problem()
    if problem is None and "--tests" in sys.argv:
        problem = library_problem() or browser_problem()
    if problem:
        print("make: " + problem, file=sys.stderr)
    return 1 if problem else 0


def python_problem():
    """What is wrong with the interpreter, None if nothing is."""
    found = ".".join(map(str, sys.version_info[:3]))
    if not (3, 11) <= sys.version_info[:2] < (3, 15):
        return (
            f"{sys.executable} is Python {found}; expected 3.11 to 3.14. Install one, or: make PYTHON=python3.12 demo"
        )
    if importlib.util.find_spec("ensurepip") is None or importlib.util.find_spec("venv") is None:
        package = f"python{sys.version_info[0]}.{sys.version_info[1]}-venv"
        return f"Python {found} has no venv module. Install it: apt-get install -y {package}"
    return None


def library_problem():
    """Which system libraries are missing, None if none is (any more: Debian's are installed when run as root)."""
    if sys.platform != "linux":
        return None
    missing = [package for library, package in LIBRARIES.items() if not loads(library)]
    if not missing or (installed(missing, "Open3D's libraries") and all(map(loads, LIBRARIES))):
        return None
    return f"Open3D's system libraries are missing, which tests need. Install them: {command_for(missing)}"


def loads(library):
    """Whether the dynamic linker finds a library."""
    try:
        ctypes.CDLL(library)
    except OSError:
        return False
    return True


def browser_problem():
    """Why there is no browser for the tests, None if there is one (Debian's is installed when run as root)."""
    if find_browser() or (installed(["chromium"], "Chromium") and find_browser()):
        return None
    wanted = f"no Chromium or Chrome was found; the browser tests need one. Install it: {command_for(['chromium'])}"
    if os.environ.get("CI") == "true":
        return wanted
    print("make: " + wanted + " (the browser tests are skipped)", file=sys.stderr)
    return None


def find_browser():
    """Whether a browser is on the path."""
    return any(shutil.which(name) for name in BROWSERS)


def installed(packages, what):
    """Whether Debian's packages could be installed: tried only as root, where apt-get is."""
    if sys.platform != "linux" or os.geteuid() != 0 or not shutil.which("apt-get"):
        return False
    print(f"Installing {what} for the tests: {command_for(packages)}", flush=True)
    return subprocess.run(command_for(packages), shell=True, stdout=subprocess.DEVNULL).returncode == 0


def command_for(packages):
    """The line that a person would type."""
    return "apt-get update && apt-get install -y --no-install-recommends " + " ".join(packages)


if __name__ == "__main__":
    sys.exit(main())
