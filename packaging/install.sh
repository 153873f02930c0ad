#!/bin/sh
# Install the program from the folder of this file, without a network: ./install.sh [PLACE], by default
# /opt/inertial-test-bench. Each version has a folder of its own, PLACE-VERSION, and PLACE is a link to the newest one: a
# run that is under way goes on with its version.
set -eu
here=$(cd "$(dirname "$0")" && pwd)
place=${1:-/opt/inertial-test-bench}
python=${PYTHON:-python3}

fail() {
    echo "$1" >&2
    exit 1
}

cd "$here"
sha256sum --quiet --check SHA256SUMS || fail "The bundle is damaged: copy it again. Nothing was installed."
given=$("$python" -c 'import platform, sys; print("%d.%d" % sys.version_info[:2], platform.machine())') ||
    fail "$python cannot be used; name another one: PYTHON=/path/to/python3 ./install.sh"
[ "$given" = "$(cat made_for)" ] ||
    fail "The bundle is for Python $(cat made_for), $python is $given. Name another one (PYTHON=/path/to/python3 ./install.sh), or make a bundle with this one."
"$python" -c 'import ensurepip' 2> /dev/null || fail "$python has no ensurepip: install Debian's package python3-venv."
[ -L "$place" ] || [ ! -e "$place" ] || fail "$place is a folder, and would be a link: move it away when no run is under way."

version=$(basename wheels/inertial_test_bench-*.whl | cut -d - -f 2)
folder=$place-$version
[ ! -e "$folder" ] || fail "$folder is there already: remove it first, if no run uses it."
"$python" -m venv "$folder"
if ! "$folder/bin/python" -m pip install --quiet --disable-pip-version-check --no-index --find-links wheels \
    "inertial-test-bench[station,pdf,sign,dcc]"; then
    rm -rf "$folder"
    fail "Nothing was installed."
fi
ln -s "$folder" "$place.new"
mv -T "$place.new" "$place"
echo "$place/bin/bench is version $version"
