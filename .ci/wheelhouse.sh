#!/usr/bin/env bash
# SPDX-License-Identifier: Apache-2.0
# comcal[can] on a computer without internet, as README describes it: wheels are collected where
# there is a network, and installed from their folder alone. Prints both sizes.
#   bash .ci/wheelhouse.sh
# Exit code 77: no wheels could be had here.
set -euo pipefail
cd "$(dirname "${BASH_SOURCE[0]}")/.."
root=$PWD
export PIP_DISABLE_PIP_VERSION_CHECK=1
unset PYTHONHOME PYTHONPATH
python=${COMCAL_VENV:-$root/.venv}/bin/python
work=$(mktemp -d)
trap 'rm -rf "$work"' EXIT

megabytes() { du -sk "$1" | awk '{ printf "%.0f MB", $1 / 1024 }'; }

# Where the internet is.
"$python" -m pip wheel --quiet --no-deps --wheel-dir "$work/wheelhouse" "$root"
wheel=$(echo "$work"/wheelhouse/comcal-*.whl)
if ! "$python" -m pip download --quiet --only-binary :all: --dest "$work/wheelhouse" "${wheel}[can]"; then
    echo "no wheels for the extra 'can' can be downloaded here; is this machine online?"
    exit 77
fi

# Where it is not.
"$python" -m venv "$work/venv"
bin=$work/venv/bin
empty=$(megabytes "$work/venv")
"$bin/python" -m pip install --quiet --no-index --find-links "$work/wheelhouse" 'comcal[can]'

cd "$work"
"$bin/comcal" --help >/dev/null
"$bin/comcal" generate biped14 -o robot >/dev/null
cat >>robot/robot.yaml <<'YAML'

sources:
  can:
    buses: {can0: {interface: socketcan, channel: can0, bitrate: 1000000}}
    sensors: {l_foot: {bus: can0, device: robotous_rft}}
YAML
"$bin/comcal" check robot/robot.yaml
"$bin/python" - <<'PYTHON'
from pathlib import Path

import numpy as np

from comcal.robot.description import load_robot
from comcal_drivers.devices.configuration import read_configuration
from comcal_drivers.frames.logs import read_log
from comcal_drivers.source.stream import SampleStream

# Robotous RFT manual 1.8: 0x0B, forces / 50 N, then moments / 2000 N m, big-endian, over two frames.
log = Path("frames.log")
log.write_text(
    "(1.000000) can0 001#0B0064FF9C138800\n(1.000100) can0 002#C8FF3803E8000000\n", "utf-8"
)
robot = load_robot("robot/robot.yaml")
stream = SampleStream(read_configuration(robot.sources["can"], robot), robot)
for batch in read_log(log):
    blocks = [stream.feed({"can0": batch}), stream.finish()]
found = np.concatenate([block.wrenches["l_foot"] for block in blocks])
np.testing.assert_allclose(found, [[2.0, -2.0, 100.0, 0.1, -0.1, 0.5]], rtol=1e-12)
print("decoded without the checkout:", found[0])
PYTHON

wheels=("$work"/wheelhouse/*.whl)
echo "wheelhouse: $(megabytes "$work/wheelhouse"), ${#wheels[@]} wheels"
echo "installed: $(megabytes "$work/venv"), of which $empty are the environment itself"
