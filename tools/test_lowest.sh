#!/bin/sh
# `make test-lowest`: build the wheel, install it with the lowest versions that pyproject.toml allows, and run the fast
# tests of the core. Tests that need ROS are omitted. Arguments are passed to pytest.
set -eu
cd "$(dirname "$0")/.."

bin=$PWD/.venv/bin
place=$PWD/build/lowest
rm -rf "$place"
mkdir -p "$place/project"

"$bin/uv" build --quiet --wheel --no-build-isolation --python "$bin/python" --out-dir "$place" .
"$bin/uv" venv --quiet --python "$bin/python" "$place/venv"
python=$place/venv/bin/python
# uv treats the requirements of a wheel as indirect, so they are installed from pyproject.toml. The versions of the test
# tools come from the lock file.
tools=$(grep -E '^(pytest|pytest-timeout|pytest-rerunfailures|pytest-xdist|hypothesis)==' requirements.lock | cut -d ' ' -f 1)
# shellcheck disable=SC2086
"$bin/uv" pip install --quiet --python "$python" --resolution lowest-direct \
    --requirements pyproject.toml --extra sim --extra view --extra report --extra monitor $tools
"$bin/uv" pip install --quiet --python "$python" --no-deps "$place"/servoloop-*.whl
"$bin/uv" pip list --quiet --python "$python"

# Copy the tests and link the files that they read, but not the packages of the checkout.
cp -R tests "$place/project/"
for name in pyproject.toml requirements.lock README.md CHANGELOG.md docs config urdf interfaces; do
    ln -s "$PWD/$name" "$place/project/$name"
done
cd "$place/project"
"$place/venv/bin/servoloop" --help > /dev/null
exec "$python" -m pytest -m 'not slow and not soak and not ros' -n 2 --dist loadfile \
    tests/drivers tests/hal tests/controller "$@"
