"""Exit with 0 if .venv can use this Python; otherwise print the reason in one line. The script runs on any Python
version."""

import os
import sys


def complaint():
    if sys.version_info < (3, 11) or sys.version_info >= (3, 14):
        return "is version %d.%d" % sys.version_info[:2]
    import importlib.util
    import platform
    import sysconfig

    if platform.python_implementation() != "CPython" or sys.maxsize < 2**32:
        return "is not a 64-bit CPython"
    libc, version = platform.libc_ver()
    if libc != "glibc" or tuple(int(part) for part in version.split(".")[:2]) < (2, 28):
        return "runs on " + (libc + " " + version if libc else "another C library") + "; the wheels need glibc 2.28"
    if importlib.util.find_spec("venv") is None or importlib.util.find_spec("ensurepip") is None:
        return "has no venv (Debian: python%d.%d-venv)" % sys.version_info[:2]
    if not os.path.exists(os.path.join(sysconfig.get_path("include"), "Python.h")):
        return "has no headers (Debian: python%d.%d-dev)" % sys.version_info[:2]
    return None


reason = complaint()
if reason:
    sys.exit(reason)
