#!/bin/sh
# `make setup`: check whether this machine is supported, find a usable Python, and run set_up.py with it.
set -eu
cd "$(dirname "$0")/.."

fail() {
    printf 'make setup: %s\n' "$1" >&2
    shift
    for line in "$@"; do printf '  %s\n' "$line" >&2; done
    exit 1
}

case "$(uname -s) $(uname -m)" in
    "Linux x86_64") ;;
    *) fail "this is $(uname -s) on $(uname -m); the ROS 2 wheels are for Linux on x86_64 only." \
            "On another machine, such as a Raspberry Pi, use a ROS 2 Jazzy installation: docs/ros2.md, 'On another" \
            "machine', has the commands. Without ROS, \"pip install '.[sim]'\" in a virtual environment installs" \
            "everything except the ROS interface: 'servoloop emulate' and 'servoloop bench bus' run." ;;
esac

missing=
for tool in gcc g++ make; do
    command -v "$tool" > /dev/null 2>&1 || missing="$missing $tool"
done
[ -z "$missing" ] || fail "not found:$missing" \
    "They build the ROS 2 message packages. On Debian or Ubuntu: sudo apt install build-essential"

# Keep the Python that created .venv, so that a different PATH does not cause a new .venv.
made_by=
[ ! -f .venv/pyvenv.cfg ] || made_by=$(sed -n 's/^executable = //p' .venv/pyvenv.cfg)

python=
reasons=
for candidate in ${PYTHON:-"$made_by" python3 python3.13 python3.12 python3.11}; do
    [ -n "$candidate" ] && command -v "$candidate" > /dev/null 2>&1 || continue
    if reason=$("$candidate" tools/usable_python.py 2>&1); then
        python=$(command -v "$candidate")
        break
    fi
    reasons="$reasons
    $candidate: $(printf '%s\n' "$reason" | tail -n 1)"
done
[ -n "$python" ] || fail "no usable Python 3.11, 3.12 or 3.13 on the PATH.$reasons" \
    "Install one of them with headers and venv. Debian and Ubuntu: sudo apt install python3 python3-dev python3-venv" \
    "If your Python is not on the PATH: make setup PYTHON=/path/to/python3.12"

# Tell users who have chosen a Python with PATH or PYENV_VERSION that a different Python is used.
[ -z "$reasons" ] || printf 'make setup: %s is used, because other versions cannot be used:%s\n' "$python" "$reasons"

exec "$python" -B tools/set_up.py
