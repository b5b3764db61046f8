"""Says in one line what this machine lacks, with the exact command that brings it; standard library only.

`check_machine.py` checks Python and Open3D's system libraries; `--browser` also wants Chromium or Chrome, and installs
Debian's when run as root.
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
    problem = python_problem() or library_problem()
    if problem is None and "--browser" in sys.argv:
        problem = browser_problem()
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
    """Which system libraries are missing, None if none is."""
    if sys.platform != "linux":
        return None
    missing = [package for library, package in LIBRARIES.items() if not loads(library)]
    if missing:
        return f"system libraries are missing. Install them: apt-get update && apt-get install -y {' '.join(missing)}"
    return None


def loads(library):
    """Whether the dynamic linker finds a library."""
    try:
        ctypes.CDLL(library)
    except OSError:
        return False
    return True


def browser_problem():
    """Why there is no browser for the tests, None if there is one (Debian's is installed when run as root)."""
    if any(shutil.which(name) for name in BROWSERS):
        return None
    command = "apt-get update && apt-get install -y --no-install-recommends chromium"
    if sys.platform == "linux" and hasattr(os, "geteuid") and os.geteuid() == 0 and shutil.which("apt-get"):
        print("Installing Chromium for the browser tests: " + command)
        if subprocess.run(command, shell=True, stdout=subprocess.DEVNULL).returncode == 0 and shutil.which("chromium"):
            return None
        return "Chromium could not be installed. Run by hand: " + command
    wanted = f"no Chromium or Chrome was found; the browser tests need one. Install it: {command}"
    if os.environ.get("CI") == "true":
        return wanted
    print("make: " + wanted + " (the browser tests are skipped)", file=sys.stderr)
    return None


if __name__ == "__main__":
    sys.exit(main())
